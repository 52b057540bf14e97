"""Which layout a path has, and opening it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.numbered import list_files, shown
from degense.engine.data.readers.cholecseg8k import cholec_frames, open_cholecseg8k
from degense.engine.data.readers.endonerf import open_endonerf
from degense.engine.data.readers.endovis18 import FRAMES, open_endovis18
from degense.engine.data.readers.finding import clips_within
from degense.engine.data.readers.frames import open_frames
from degense.engine.data.readers.relabelled import with_labels
from degense.engine.data.readers.video import SUFFIXES, open_video
from degense.engine.errors import ClipError

OPENERS: dict[str, Callable[[Path, ClipOptions], Clip]] = {
    "endonerf": open_endonerf,
    "cholecseg8k": open_cholecseg8k,
    "endovis18": open_endovis18,
    "frames": open_frames,
    "video": open_video,
}


def detect(path: str | Path) -> str:
    """The layout of a clip: "endonerf", "cholecseg8k", "endovis18", "frames" or "video".

    Raises
    ------
    ClipError
        When there is nothing, nothing that is a clip, or several clips.
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
    if cholec_frames(path):
        return "cholecseg8k"
    if (path / FRAMES).is_dir():
        return "endovis18"
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
    """Open a clip. What was decided on the way stands in its `provenance`, in words.

    Parameters
    ----------
    path : str or Path
        A folder in a known layout, a folder of frames, or a video file.
    options : ClipOptions, optional

    Raises
    ------
    ClipError
        One sentence: which file, what is wrong, what to do.
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
