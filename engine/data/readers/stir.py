"""A sequence of STIR, and of VL-SurgPT, which shares its tree: `NAME/left/seqNN/frames/*.mp4`, and for STIR `NAME/calib.json`.

Where its points are lies in `segmentation/` or `annotation/` beside the frames; `engine.data.files.point_trees` reads it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import ClipCameras, clip_cameras, guessed_cameras
from degense.engine.data.files.numbered import list_files, read_json, regular_file, shown
from degense.engine.data.readers.video import video_clip
from degense.engine.errors import ClipError

FRAMES = "frames"
WIDTH = 1280  # of the published frames, which the calibration is for
FORM = '"leftcameramat": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]'


def is_stir(folder: Path) -> bool:
    """Whether a folder looks like a sequence."""
    return (folder / FRAMES).is_dir() and any(file.suffix.lower() == ".mp4" for file in (folder / FRAMES).iterdir())


def open_stir(path: Path, options: ClipOptions) -> Clip:
    """Open one view of a sequence. ClipError when it cannot be read."""
    videos = list_files(path / FRAMES, path, (".mp4",))
    if len(videos) != 1:
        raise ClipError(f"{shown(path / FRAMES)} holds {len(videos)} videos (.mp4), but a sequence has one.")

    def cameras_of(count: int, size: tuple[int, int], field: np.ndarray | None, options: ClipOptions) -> ClipCameras:
        calibration = path.parent.parent / "calib.json"
        if options.focal or not calibration.exists():
            return guessed_cameras(count, size, field, options)
        camera, words = _camera(regular_file(calibration, calibration.parent), path.parent.name, size)
        return clip_cameras([camera] * count, None, words, options)

    return replace(video_clip(videos[0], options, cameras_of), name=path.name, path=path)


def _camera(path: Path, view: str, size: tuple[int, int]) -> tuple[Camera, str]:
    """The camera of the view ("left…" or "right…") and its provenance."""
    side = "right" if view.startswith("right") else "left"
    try:
        data = read_json(path)
        lens = np.array(data[f"{side}cameramat"], np.float64)
        bent = np.array(data.get(f"{side}distortioncoeffs", 0), np.float64)
        sound = lens.shape == (3, 3) and np.isfinite(lens).all() and lens[0, 0] > 0 and lens[1, 1] > 0
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ClipError(f"{shown(path)} must hold {FORM}.") from error
    if not sound:
        raise ClipError(f"{shown(path)} must hold {FORM}.")
    scale = size[0] / WIDTH
    fx, fy, cx, cy = (float(value) * scale for value in (lens[0, 0], lens[1, 1], lens[0, 2], lens[1, 2]))
    words = f"{fx:.6g} pixels, from {path.name}"
    words += "" if math.isclose(scale, 1) else f", scaled from {WIDTH} pixels of width"
    words += "; lens distortion is not taken out" if np.any(bent != 0) else ""
    return Camera(*size, fx, fy, cx + 0.5, cy + 0.5), words  # middles of pixels are whole numbers in calibrations
