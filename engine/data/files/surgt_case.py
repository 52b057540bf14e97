"""A case of SurgT: what its `info.yaml` says, the rectification of its left view, and where the tracked tissue is.

`info.yaml` names the stereo video (`name_video`), how its views are stacked (`video_stack`: vertical, left above, or horizontal), the
`resolution` of one view and the files of ground truth (`name_ground_truth`). `calibration.yaml` holds M1, D1, M2, D2, R and T as OpenCV
writes them, in pixels and millimetres. Frames are rectified as the challenge does it, and ground truth is in rectified pixels.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from degense.engine.data.files.numbered import regular_file, shown
from degense.engine.errors import ClipError
from degense.engine.untrusted import check_yaml

INFO, CALIBRATION = "info.yaml", "calibration.yaml"
MOST_CALIBRATION = 1 << 14  # bytes: OpenCV's parser ends the process on some hundred thousand nested brackets
MOST_BYTES = 1 << 21  # of YAML, of which some 500 kB are read a second
MOST_PIXELS = 1 << 26
SHAPES = {"M1": (3, 3), "M2": (3, 3), "R": (3, 3), "T": (3, 1), "D1": (5,), "D2": (5,)}


@dataclass(frozen=True)
class SurgtCase:
    """What `info.yaml` says; `size` is (width, height) of one view, `crop` the rows and columns of the left one."""

    video: Path
    truth: tuple[Path, ...]  # one file of bounding boxes a tracked piece of tissue
    size: tuple[int, int]
    crop: tuple[slice, slice]


def is_surgt_case(folder: Path) -> bool:
    """Whether a folder looks like a case of SurgT."""
    return (folder / INFO).is_file() and (folder / CALIBRATION).is_file()


def read_case(folder: Path) -> SurgtCase:
    """ClipError for a damaged `info.yaml`, or one that names files outside the folder."""
    file = regular_file(folder / INFO, folder)
    try:
        info = read_yaml(file)
        size = int(info["resolution"]["width"]), int(info["resolution"]["height"])
        names = [str(info["name_video"]), *map(str, info["name_ground_truth"])]
        stack = info["video_stack"]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ClipError(f"{shown(file)} must name name_video, video_stack, resolution and name_ground_truth, as of SurgT.") from error
    if min(size) < 1 or size[0] * size[1] > MOST_PIXELS or stack not in ("vertical", "horizontal"):
        raise ClipError(f"{shown(file)} needs a resolution in pixels, and a video_stack that is vertical or horizontal.")
    video, *truth = (regular_file(folder / name, folder) for name in names)
    return SurgtCase(video, tuple(truth), size, (slice(0, size[1]), slice(0, size[0])))


def rectification(folder: Path, size: tuple[int, int]) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """Where each pixel of the rectified left view is seen, float32 [H, W, 2], and its fx, fy, cx, cy. ClipError for a damaged file."""
    file = regular_file(folder / CALIBRATION, folder)
    if file.stat().st_size > MOST_CALIBRATION:
        raise ClipError(f"{shown(file)} is larger than {MOST_CALIBRATION >> 10} kB; that is no camera calibration.")
    found = {}
    try:
        storage = cv2.FileStorage(file.read_text("utf-8"), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        for name, shape in SHAPES.items():
            values = np.asarray(storage.getNode(name).mat(), np.float64)
            found[name] = values.reshape(shape)
            if not np.isfinite(values).all():
                raise ValueError(name)
    except (cv2.error, ValueError, TypeError, SystemError) as error:
        raise ClipError(f"{shown(file)} needs the matrices M1, D1, M2, D2, R and T, as OpenCV writes them.") from error
    m1, d1, m2, d2, r, t = (found[name] for name in ("M1", "D1", "M2", "D2", "R", "T"))
    try:
        turn, _, lens, *_ = cv2.stereoRectify(m1, d1, m2, d2, size, r, t, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0.0)
        places = cv2.initUndistortRectifyMap(m1, d1, turn, lens, size, cv2.CV_32FC2)[0]
    except cv2.error as error:
        raise ClipError(f"{shown(file)} holds no calibration of two cameras; copy it again.") from error
    if not np.isfinite(lens).all() or lens[0, 0] <= 0 or lens[1, 1] <= 0:
        raise ClipError(f"{shown(file)} holds no calibration of two cameras; copy it again.")
    return places, (float(lens[0, 0]), float(lens[1, 1]), float(lens[0, 2]) + 0.5, float(lens[1, 2]) + 0.5)


def read_boxes(file: Path, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the left bounding boxes, float64 [T, 2], NaN where there is none or it is called difficult; bool [T], not visible.

    A file holds, for each frame, [visible in both views, difficult, [left box, right box] or null], boxes as u, v, width, height. Frames
    beyond `frames` are left out. ClipError for a damaged file.
    """
    pixels, hidden = np.full((frames, 2), np.nan), np.zeros(frames, bool)
    try:
        data = read_yaml(file)
        for index, entry in data.items() if isinstance(data, dict) else enumerate(data):
            visible, difficult, boxes = entry
            if not 0 <= (frame := operator.index(index)) < frames:
                continue
            hidden[frame] = not visible
            if visible and not difficult and boxes is not None:
                u, v, width, height = map(float, boxes[0])
                pixels[frame] = u + width / 2, v + height / 2
    except (LookupError, TypeError, ValueError, OverflowError) as error:
        raise ClipError(f"{shown(file)} is damaged, or not the ground truth of SurgT.") from error
    return pixels, hidden


def read_yaml(file: Path) -> Any:
    """Plain values of a YAML file; Python tuples in it are read as lists, other objects never. ClipError otherwise."""
    import yaml

    plain: Any = type("Plain", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
    plain.add_constructor("tag:yaml.org,2002:python/tuple", lambda loader, node: loader.construct_sequence(node, deep=True))
    if file.stat().st_size > MOST_BYTES:
        raise ClipError(f"{shown(file)} is larger than {MOST_BYTES >> 20} MB; that is no file of SurgT.")
    try:
        text = file.read_text("utf-8")
        check_yaml(text)
        return yaml.load(text, plain)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ClipError(f"{shown(file)} is not valid YAML without objects.") from error
