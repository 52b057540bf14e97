"""Folders of frames: pictures in the folder or in its `images/`; beside them may lie `masks/` or `gt_masks/`, `depth/` or `monodepth/`,
`labels/` with `classes.json`, `strokes/`, `gt.npz`, and a file of cameras (`camera.json`; see `endonerf` for the other one).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import ClipCameras, guessed_cameras, json_cameras, json_unit
from degense.engine.data.files.depth import DepthFiles, DepthPrior
from degense.engine.data.files.images import ImageFiles, check_sizes
from degense.engine.data.files.labels import index_maps, read_classes
from degense.engine.data.files.masks import MaskFiles, border_words, brightest, decide, field_of_view, read_mask
from degense.engine.data.files.numbered import list_files, pair, regular_file, shown
from degense.engine.data.files.numpy_files import TruthFile, open_npy
from degense.engine.data.files.stored import StoredClip, counted, looked_at, map_words
from degense.engine.errors import ClipError

#: Reads a file of cameras, for a number of frames of a size.
ReadCameras = Callable[[Path, int, tuple[int, int], ClipOptions], ClipCameras]


def open_frames(path: Path, options: ClipOptions) -> Clip:
    """Open a folder of frames. ClipError when it cannot be read."""
    camera = path / "camera.json"
    clip = open_folder(path, options, camera, json_cameras, clip_depth=False)
    if camera.exists() and clip.depth_measured:
        clip.unit = json_unit(camera)
    return clip


def open_folder(path: Path, options: ClipOptions, camera: Path, read_cameras: ReadCameras, clip_depth: bool) -> StoredClip:
    """Open a folder; with `clip_depth`, depth is clipped to robust percentiles, for it is not exact."""
    files = frame_files(path)
    pictures = ImageFiles(files)
    size, count = pictures.size, len(files)
    mask_paths = mask_files(path, files, size)
    some = looked_at(count)
    if mask_paths:  # an empty mask compresses best, so the largest file is one that says something
        some = sorted({*some, max(looked_at(count, count), key=lambda i: mask_paths[i].stat().st_size)})
    frames = [pictures.read(i) for i in some]

    masks, border, disc, words = _masks(mask_paths, some, frames, size, options)
    inside = np.ones(size[::-1], bool) if border is None else border
    if camera.exists():
        found = read_cameras(regular_file(camera, path), count, size, options)
    else:
        found = guessed_cameras(count, size, disc, options)
    distances: DepthFiles | DepthPrior | None
    distances, depth_words = _depth_files(path, files, size, clip_depth)
    if distances is None:
        usable = [inside if masks is None else inside & masks.keep(i) for i in some]
        distances = DepthPrior(frames, usable, found.cameras[0])
        depth_words = distances.words
    labels, strokes = index_maps(path, files, size), index_maps(path, files, size, "strokes")
    provenance = {"frames": counted(files, size), "masks": words, **found.provenance, "depth": depth_words}
    return StoredClip(
        name=path.name,
        path=path,
        cameras=found.cameras,
        poses=found.poses,
        classes=_classes(path),
        provenance=provenance | map_words(labels, count, "labels") | map_words(strokes, count, "strokes"),
        pictures=pictures,
        inside=inside,
        distances=distances,
        masks=masks,
        label_maps=labels,
        stroke_maps=strokes,
        truth_file=TruthFile(regular_file(path / "gt.npz", path), count, size) if (path / "gt.npz").exists() else None,
    )


def _masks(
    files: list[Path], some: list[int], frames: list[np.ndarray], size: tuple[int, int], options: ClipOptions
) -> tuple[MaskFiles | None, np.ndarray | None, np.ndarray | None, str]:
    """The masks, the dark border to leave out, the visible disc that tells the focal length, and provenance."""
    border = field_of_view(brightest(frames))
    words = border_words(border, "dark border")
    if not files:
        return None, border, border, words
    highs, tops = zip(*(read_mask(files[i], size) for i in some), strict=True)
    polarity = decide(highs, frames, max(tops), options.mask_means)
    disc = border
    if polarity.means == "keep":  # such masks have said where the field of view is
        border, disc = None, field_of_view(np.any(highs, axis=0).astype(np.uint8) * 255)
    extra = "" if border is None else words.removeprefix("none")
    return MaskFiles(files, size, polarity), border, disc, f"{files[0].parent.name}/: {polarity.words}{extra}"


def _classes(path: Path) -> tuple[str, ...]:
    """What `classes.json` names; empty without it."""
    file = path / "classes.json"
    return read_classes(regular_file(file, path)) if file.exists() else ()


def frame_files(path: Path) -> list[Path]:
    """The frames of a folder: in `images/`, else in the folder itself. ClipError when there are none."""
    folder = path / "images" if (path / "images").is_dir() else path
    files = list_files(folder, path)
    if not files:
        raise ClipError(f"{shown(folder)} holds no pictures (.png, .jpg, .bmp, .tif, .webp).")
    return files


def mask_files(path: Path, frames: list[Path], size: tuple[int, int]) -> list[Path]:
    """The masks of a folder, one a frame; empty when it has none. `gt_masks/` is SurgicalGaussian's name for them.

    ClipError when they do not fit the frames.
    """
    files = list_files(path / "masks", path) or list_files(path / "gt_masks", path)
    if files:
        pair(frames, files, "masks")
        check_sizes(files, size)
    return files


def _depth_files(path: Path, frames: list[Path], size: tuple[int, int], clip_depth: bool) -> tuple[DepthFiles | None, str]:
    for name in ("depth", "monodepth"):
        files = list_files(path / name, path, (".npy",)) or list_files(path / name, path)
        if not files:
            continue
        pair(frames, files, "depth maps")
        exact = files[0].suffix.lower() == ".npy"
        if exact:
            for file in files:
                open_npy(file)
        else:
            check_sizes(files, size)
        distances = DepthFiles(files, size)
        few = looked_at(len(files))
        limits = distances.robust_limits(few)
        if limits is None:
            raise ClipError(f"{shown(path / name)} holds no depth: every value looked at is 0 or not finite; remove the folder or mend it.")
        kind = "monocular estimate, up to a scale" if name == "monodepth" else "measured"
        words = f"{kind}, from {name}/ ({'.npy' if exact else 'raw picture values'}), 0 = unknown"
        if clip_depth:
            distances.limits = limits
            words += f", clipped to {limits[0]:.4g} … {limits[1]:.4g}"
        return distances, words
    return None, ""
