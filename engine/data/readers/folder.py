"""Opening a folder of pictures with masks, depth, labels and truth beside them: what the layouts endonerf and frames share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from degense.engine.camera import Camera
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.depth import DepthPrior
from degense.engine.data.files.depth_files import DepthFiles
from degense.engine.data.files.field_of_view import border_words, brightest, field_of_view
from degense.engine.data.files.images import ImageFiles, check_sizes
from degense.engine.data.files.labels import index_maps, read_classes
from degense.engine.data.files.masks import MaskFiles, decide, read_mask
from degense.engine.data.files.numbered import list_files, pair, regular_file, shown
from degense.engine.data.files.numpy_header import open_npy
from degense.engine.data.files.poses import Found
from degense.engine.data.files.stored import StoredClip, counted, map_words, sampled
from degense.engine.data.files.truth import TruthFile
from degense.engine.errors import ClipError

CameraRule = Callable[[int, tuple[int, int], np.ndarray | None], Found]


def open_folder(path: Path, options: ClipOptions, cameras: CameraRule, clip_depth: bool) -> StoredClip:
    """Open a folder.

    Parameters
    ----------
    path : Path
    options : ClipOptions
    cameras : (count, size, field of view or None) -> Found
    clip_depth : bool
        Clip depth to robust percentiles; false when it is known to be exact.

    Raises
    ------
    ClipError
    """
    files = frame_files(path)
    pictures = ImageFiles(files)
    size, count = pictures.size, len(files)
    masks = mask_files(path, files, size)
    looked_at = sampled(count)
    if masks:  # an empty mask compresses best, so the largest file is one that says something
        looked_at = sorted({*looked_at, max(range(count), key=lambda i: masks[i].stat().st_size)})
    frames = [pictures.read(i) for i in looked_at]
    provenance = {"frames": counted(files, size)}

    decided, border = None, field_of_view(brightest(frames))
    words, disc = border_words(border, "dark border"), border
    if masks:
        highs, tops = zip(*(read_mask(masks[i], size) for i in looked_at), strict=True)
        polarity = decide(highs, frames, max(tops), options.mask_means)
        decided = MaskFiles(masks, size, polarity)
        if polarity.means == "keep":  # such masks have said where the field of view is
            border, disc = None, field_of_view(np.any(highs, axis=0).astype(np.uint8) * 255)
        extra = "" if border is None else border_words(border, "dark border").removeprefix("none")
        words = f"{masks[0].parent.name}/: {polarity.words}{extra}"
    provenance["masks"] = words
    inside = np.ones(size[::-1], bool) if border is None else border
    found = cameras(count, size, disc)
    provenance |= found.provenance

    usable = [inside if decided is None else inside & decided.keep(i) for i in looked_at]
    distances, provenance["depth"] = _distances(path, files, size, clip_depth) or _prior(frames, usable, found.cameras[0])
    labels = index_maps(path, files, size)
    strokes = index_maps(path, files, size, "strokes")
    provenance["labels"] = map_words(labels, count, "labels")
    if strokes:
        provenance["strokes"] = map_words(strokes, count, "strokes")
    truth = TruthFile(regular_file(path / "gt.npz", path), count, size) if (path / "gt.npz").exists() else None
    return StoredClip(
        name=path.name,
        path=path,
        cameras=found.cameras,
        poses=found.poses,
        classes=_classes(path),
        provenance=provenance,
        pictures=pictures,
        inside=inside,
        distances=distances,
        masks=decided,
        label_maps=labels,
        stroke_maps=strokes,
        truth_file=truth,
    )


def _classes(path: Path) -> tuple[str, ...]:
    """What `classes.json` names; empty without it."""
    file = path / "classes.json"
    return read_classes(regular_file(file, path)) if file.exists() else ()


def frame_files(path: Path) -> list[Path]:
    """The frames of a folder: in `images/`, else in the folder itself.

    Raises
    ------
    ClipError
        When there are none.
    """
    folder = path / "images" if (path / "images").is_dir() else path
    files = list_files(folder, path)
    if not files:
        raise ClipError(f"{shown(folder)} holds no pictures (.png, .jpg, .bmp, .tif, .webp).")
    return files


def mask_files(path: Path, frames: list[Path], size: tuple[int, int]) -> list[Path]:
    """The masks of a folder, one a frame; empty when it has none. `gt_masks/` is SurgicalGaussian's name for them.

    Raises
    ------
    ClipError
    """
    files = list_files(path / "masks", path) or list_files(path / "gt_masks", path)
    if files:
        pair(frames, files, "masks")
        check_sizes(files, size)
    return files


def _distances(path: Path, frames: list[Path], size: tuple[int, int], clip_depth: bool) -> tuple[DepthFiles, str] | None:
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
        few = sampled(len(files))
        limits = distances.robust_limits(few)
        if limits is None:
            raise ClipError(f"{shown(path / name)} holds no depth: every value looked at is 0 or not finite; remove the folder or mend it.")
        kind = "monocular estimate, up to a scale" if name == "monodepth" else "measured"
        words = f"{kind}, from {name}/ ({'.npy' if exact else 'raw picture values'}), 0 = unknown"
        if clip_depth:
            distances.limits = limits
            words += f", clipped to {limits[0]:.4g} … {limits[1]:.4g}"
        return distances, words
    return None


def _prior(frames: list[np.ndarray], usable: list[np.ndarray], camera: Camera) -> tuple[DepthPrior, str]:
    prior = DepthPrior(frames, usable, camera)
    return prior, prior.words
