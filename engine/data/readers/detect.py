"""Which layout a path has, opening a clip, and what lies in a folder of many."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.labels import index_maps
from degense.engine.data.files.numbered import list_files, shown
from degense.engine.data.files.stored import CACHE_BYTES, StoredClip, frame_names, sampled
from degense.engine.data.files.surgt_case import is_surgt_case
from degense.engine.data.readers.c3vd import is_c3vd, open_c3vd
from degense.engine.data.readers.cholecseg8k import FRAME, open_cholecseg8k
from degense.engine.data.readers.colmap import is_colmap, open_colmap
from degense.engine.data.readers.endonerf import open_endonerf
from degense.engine.data.readers.endovis18 import FRAMES, open_endovis18
from degense.engine.data.readers.frame_folder import open_frames
from degense.engine.data.readers.nerfstudio import is_nerfstudio, open_nerfstudio
from degense.engine.data.readers.servct import is_servct, open_servct
from degense.engine.data.readers.stir import is_stir, open_stir
from degense.engine.data.readers.surgt import open_surgt
from degense.engine.data.readers.video import SUFFIXES, open_video
from degense.engine.errors import ClipError
from degense.engine.latest import Latest

DEEPEST = 4  # folders down: a data set, a release, a video, a clip
MOST = 10_000

OPENERS: dict[str, Callable[[Path, ClipOptions], Clip]] = {
    "endonerf": open_endonerf,
    "cholecseg8k": open_cholecseg8k,
    "endovis18": open_endovis18,
    "stir": open_stir,
    "surgt": open_surgt,
    "servct": open_servct,
    "c3vd": open_c3vd,
    "nerfstudio": open_nerfstudio,
    "colmap": open_colmap,
    "frames": open_frames,
    "video": open_video,
}
#: Folders of data sets, by what lies in them.
RECOGNISED: dict[str, Callable[[Path], bool]] = {
    "cholecseg8k": lambda folder: any(FRAME.fullmatch(file.name) for file in folder.iterdir()),
    "c3vd": is_c3vd,
    "endovis18": lambda folder: (folder / FRAMES).is_dir(),
    "servct": is_servct,
    "surgt": is_surgt_case,
    "stir": is_stir,
    "nerfstudio": is_nerfstudio,
    "colmap": is_colmap,
}


def detect(path: str | Path) -> str:
    """The layout of a clip, one of `LAYOUTS`.

    ClipError when there is nothing, nothing that is a clip, or several clips.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise ClipError(f"{shown(path)} does not exist.")
        if path.is_dir():
            return _detect_folder(path)
    except (OSError, ValueError) as error:
        raise ClipError(f"{shown(path)} cannot be read ({getattr(error, 'strerror', None) or 'bad name'}).") from error
    if path.suffix.lower() in SUFFIXES:
        return "video"
    raise ClipError(f"{shown(path)} is no clip: give a folder of frames or a video file ({', '.join(SUFFIXES)}).")


def _detect_folder(path: Path) -> str:
    for name, recognised in RECOGNISED.items():
        if recognised(path):
            return name
    images = path / "images"
    if images.is_dir():
        if (path / "camera.json").exists():
            return "frames"
        masked = (path / "masks").is_dir() or (path / "gt_masks").is_dir()
        if (path / "poses_bounds.npy").exists() or (masked and not (path / "labels").is_dir()):
            return "endonerf"
        if list_files(images, path):
            return "frames"
        raise ClipError(f"{shown(images)} holds no pictures (.png, .jpg, .bmp, .tif, .webp).")
    if list_files(path, path):
        return "frames"
    inner = clips_within(path, deepest=3)
    if len(inner) > 1 or (inner and inner[0].is_dir()):
        listed = ", ".join(shown(p.relative_to(path)) for p in inner[:12]) + (", …" if len(inner) > 12 else "")
        raise ClipError(f"{shown(path)} is no clip itself, but holds {len(inner)}: {listed}; open one of them.")
    if inner:
        raise ClipError(f"{shown(path)} holds the video {shown(Path(inner[0].name))}; open that file.")
    raise ClipError(f"{shown(path)} holds no frames: neither images/ nor pictures nor frame_<number>_endo.png.")


def open_clip(path: str | Path, options: ClipOptions | None = None) -> Clip:
    """Open a clip: a folder in a known layout, a folder of frames, or a video file. Its `provenance` says in words what was decided.

    ClipError in one sentence: which file, what is wrong, what to do.
    """
    options = options or ClipOptions()
    path = Path(path)
    layout = detect(path)
    if options.layout is not None:
        if (options.layout == "video") != path.is_file():
            raise ClipError(f"{shown(path)} is a {'file' if path.is_file() else 'folder'}, so it cannot have the layout {options.layout}.")
        layout = options.layout
    try:
        clip = OPENERS[layout](path, options)
    except PermissionError as error:
        raise ClipError(f"{shown(Path(error.filename or path))} may not be read; check its permissions.") from error
    if options.labels is not None:
        clip = with_labels(clip, Path(options.labels))
    clip.options = {item.name: value for item in fields(options) if (value := getattr(options, item.name)) != item.default}
    return clip


def clips_within(path: Path, deepest: int = DEEPEST) -> list[Path]:
    """Clip folders and videos below a folder, in the order of their names, at most `MOST`; links and hidden folders are left out."""
    found: list[Path] = []
    for child in sorted(path.iterdir()):
        if child.name.startswith(".") or child.is_symlink() or len(found) >= MOST:
            continue
        if child.is_file():
            if child.suffix.lower() in SUFFIXES:
                found.append(child)
        elif child.is_dir() and os.access(child, os.R_OK | os.X_OK):
            if is_clip(child):
                found.append(child)
            elif deepest > 1:
                found += clips_within(child, deepest - 1)
    return found


def is_clip(folder: Path) -> bool:
    """Whether a folder looks like a clip: it has frames in a place of their own, or is that of a data set."""
    return (folder / "images").is_dir() or any(recognised(folder) for recognised in RECOGNISED.values())


def with_labels(clip: Clip, folder: Path) -> Clip:
    """The clip with the label maps of a folder (`labels/NAME.png` and `classes.json`) instead of its own.

    They are its strokes too: what was only scribbled is for the teacher `strokes` to spread.
    ClipError when there are none, or they do not fit the clip.
    """
    if not isinstance(clip, StoredClip):
        raise ClipError(f"Clip '{clip.name}' lies in no files, so it takes no label maps from a folder.")
    maps = index_maps(folder, [Path(name) for name in frame_names(clip)], clip.size)
    if maps is None:
        raise ClipError(f"{shown(folder)} holds no labels/ with PNG files; choose the folder above it.")
    words = f"{len(maps.files)} of {len(clip)} frames, {len(maps.classes)} classes, from {shown(folder)}"
    provenance = {**clip.provenance, "labels": words, "strokes": words}
    return replace(clip, classes=maps.classes, label_maps=maps, stroke_maps=maps, provenance=provenance, cache=Latest(CACHE_BYTES))


#: The clips of CholecSeg8k on which SurgTPGS and those who compare with it report; the data set has no official split.
SURGTPGS_TEST = ("video01_00080", "video01_00240", "video01_15019", "video12_15750", "video17_01803")
#: What EndoVis 2018 and those who keep it call the folder of the test sequences.
TEST_FOLDER = re.compile(r"test(ing)?([_ -]?(data|set|release))?([_ -]?\d+)?")


@dataclass(frozen=True)
class ClipEntry:
    """A clip of a data set."""

    path: Path
    layout: str  # as `detect` names it; "unknown" where that fails
    split: str  # "train" or "test", by the folders of EndoVis 2018 and by `SURGTPGS_TEST`; empty where nothing tells
    frames: int = 0  # their number
    test_frames: int = 0  # number of held-out frames, which are never trained on
    labelled: int = 0  # number of frames with a label map
    size: tuple[int, int] = (0, 0)  # (width, height)
    classes: tuple[str, ...] = ()  # those seen in a few of its label maps
    problem: str = ""  # why it cannot be opened, in one sentence; empty when it can


def list_clips(folder: Path) -> Iterator[ClipEntry]:
    """Every clip in a folder, opened and looked at, one after the other; a folder that is a clip lists itself.

    ClipError when there is none.
    """
    if not folder.is_dir():
        raise ClipError(f"{shown(folder)} is no folder; give the folder of a data set.")
    paths = [folder] if is_clip(folder) else clips_within(folder)
    if not paths:
        raise ClipError(f"{shown(folder)} holds no clips: no images/, no folder of a known data set and no video.")
    for path in paths:
        yield look_at(path)


def look_at(path: Path) -> ClipEntry:
    """One clip; what is wrong with it stands in `problem`."""
    layout = "unknown"
    try:
        layout = detect(path)
        clip = open_clip(path)
        labelled = clip.labelled_frames
        seen: set[int] = set()
        for i in sampled(len(labelled)) if labelled else ():
            labels = clip.labels(labelled[i])
            assert labels is not None
            seen |= {int(value) for value in np.unique(labels[labels != UNLABELLED])}
    except ClipError as error:
        return ClipEntry(path, layout, _split(path, layout), problem=str(error))
    classes = tuple(clip.classes[value] for value in sorted(seen))
    return ClipEntry(path, layout, _split(path, layout), len(clip), len(clip.test_frames), len(labelled), clip.size, classes)


def _split(path: Path, layout: str) -> str:
    if layout == "cholecseg8k":
        return "test" if path.name in SURGTPGS_TEST else "train"
    if layout == "endovis18":
        return "test" if any(TEST_FOLDER.fullmatch(part.lower()) for part in path.parts[-4:-1]) else "train"
    return ""
