"""An experiment of SERV-CT: stills of one piece of anatomy from several places, with depth in millimetres from computed tomography.

`Left_rectified/NNN.png`, `Ground_truth_CT/DepthL/NNN.png` (also called `Reference_CT`; 16 bits, 1/256 mm, 0 unknown) and
`Rectified_calibration/NNN.json` with the projection P1. The places that the stills were taken from are not known.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import ClipCameras, clip_cameras, guessed_cameras
from degense.engine.data.files.depth import DepthFiles
from degense.engine.data.files.images import ImageFiles, check_sizes
from degense.engine.data.files.masks import border_words, brightest, field_of_view
from degense.engine.data.files.numbered import list_files, pair, read_json, regular_file, shown
from degense.engine.data.files.stored import clip_with_prior, counted, looked_at
from degense.engine.errors import ClipError

FRAMES, CALIBRATION = "Left_rectified", "Rectified_calibration"
REFERENCES = ("Ground_truth_CT", "Reference_CT")
STEPS = 256  # a millimetre


def is_servct(folder: Path) -> bool:
    """Whether a folder looks like an experiment."""
    return (folder / FRAMES).is_dir()


def open_servct(path: Path, options: ClipOptions) -> Clip:
    """Open the left views of an experiment. ClipError when it cannot be read."""
    frames = list_files(path / FRAMES, path, (".png",))
    if not frames:
        raise ClipError(f"{shown(path / FRAMES)} holds no pictures (001.png, …).")
    pictures = ImageFiles(frames)
    some = [pictures.read(i) for i in looked_at(len(frames))]
    field = field_of_view(brightest(some))
    cameras = _cameras(path, frames, pictures.size, field, options)
    words = {"frames": counted(frames, pictures.size) + ", left view", "masks": border_words(field, "dark border"), "labels": "none"}
    clip = clip_with_prior(path, pictures, some, field, cameras, words, unit="mm")
    for name in REFERENCES:
        if files := list_files(path / name / "DepthL", path, (".png",)):
            pair(frames, files, "depth maps")
            check_sizes(files, pictures.size)
            clip.distances = DepthFiles(files, pictures.size, 1 / STEPS)
            clip.provenance["depth"] = f"measured, from {name}/DepthL/, mm, 0 = unknown"
            return clip
    raise ClipError(f"{shown(path)} holds no {REFERENCES[0]}/DepthL/ with the depth of the left views; copy that folder too.")


def _cameras(path: Path, frames: list[Path], size: tuple[int, int], field: np.ndarray | None, options: ClipOptions) -> ClipCameras:
    files = list_files(path / CALIBRATION, path, (".json",))
    if options.focal or not files:
        return guessed_cameras(len(frames), size, field, options)
    pair(frames, files, "calibrations")
    cameras = []
    for file in files:
        try:
            lens = np.array(read_json(regular_file(file, path))["P1"]["data"], np.float64).reshape(3, 4)
        except (KeyError, TypeError, ValueError) as error:
            raise ClipError(f"{shown(file)} needs the projection P1 with its 12 numbers as data.") from error
        if not np.isfinite(lens).all() or lens[0, 0] <= 0 or lens[1, 1] <= 0:
            raise ClipError(f"{shown(file)} has a focal length that is not positive.")
        fx, fy, cx, cy = (float(lens[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
        cameras.append(Camera(*size, fx, fy, cx + 0.5, cy + 0.5))  # middles of pixels are whole numbers in calibrations
    return clip_cameras(cameras, None, f"{cameras[0].fx:.6g} pixels, from {CALIBRATION}/", options)
