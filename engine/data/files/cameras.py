"""Cameras of a clip: from LLFF pose files, from `camera.json`, or assumed."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from degense.engine.camera import Camera
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.numbered import read_json, shown
from degense.engine.data.files.numpy_files import open_npy
from degense.engine.errors import ClipError

ASSUMED_ANGLE = 70.0  # degrees across the field of view: laparoscopes have 65 to 80


def assumed_focal(size: tuple[int, int], field: np.ndarray | None) -> tuple[float, str]:
    """Focal length (pixels) and its provenance when nothing tells it: 70° across the visible disc, else across the diagonal."""
    if field is None:
        across, what = math.hypot(*size), "the diagonal"
    else:
        ys, xs = np.nonzero(field)
        across, what = float(max(np.ptp(xs), np.ptp(ys)) + 1), "the visible disc"
    focal = across / 2 / math.tan(math.radians(ASSUMED_ANGLE / 2))
    return focal, f"assumed {focal:.0f} pixels ({ASSUMED_ANGLE:.0f}° across {what}); set focal to change"


@dataclass(frozen=True)
class ClipCameras:
    """Cameras of a clip, what is to be done about their poses (`Clip.poses`), and provenance of "poses" and "focal"."""

    cameras: list[Camera]
    poses: Literal["given", "auto", "estimate"]
    provenance: dict[str, str]


def guessed_cameras(count: int, size: tuple[int, int], field: np.ndarray | None, options: ClipOptions) -> ClipCameras:
    """Cameras of a clip that brings none: at the origin, principal point in the middle."""
    focal, words = (options.focal, f"{options.focal:g} pixels, as set") if options.focal else assumed_focal(size, field)
    return clip_cameras([Camera(*size, focal, focal, size[0] / 2, size[1] / 2)] * count, None, words, options)


def calibrated_cameras(path: Path, count: int, size: tuple[int, int], made_for: tuple[int, int], options: ClipOptions) -> ClipCameras:
    """Cameras from the `camera_calibration.txt` of a da Vinci recording: `Camera-0-F: fx fy` and `Camera-0-C: cx cy`, the left view.

    Scaled from pictures of `made_for` (width, height). Distortion, which is below a pixel there, is not read.
    ClipError for a file that does not fit.
    """
    if path.stat().st_size > 2**16:
        raise ClipError(f"{shown(path)} is larger than 64 KB; that is no camera calibration.")
    found = {}
    for line in path.read_text("utf-8", "replace").splitlines():
        key, colon, rest = line.partition("//")[0].partition(":")
        if colon and key.strip() in ("Camera-0-F", "Camera-0-C"):
            found[key.strip()] = [float(word) for word in rest.split() if re.fullmatch(r"\d{1,6}(\.\d*)?", word)]
    focal, centre = found.get("Camera-0-F", []), found.get("Camera-0-C", [])
    inside = len(centre) == 2 and all(0 < place < side for place, side in zip(centre, made_for, strict=True))
    if len(focal) != 2 or min(focal) <= 0 or not inside:
        raise ClipError(f"{shown(path)} needs lines such as 'Camera-0-F: 1084.2 1084.1' and 'Camera-0-C: 580.0 506.8' (pixels).")
    scale = size[0] / made_for[0]
    fx, fy, cx, cy = (scale * value for value in (*focal, *centre))
    words = f"{fx:.6g} pixels, from {path.name}" + ("" if scale == 1 else f", scaled from {made_for[0]} pixels of width")
    return clip_cameras([Camera(*size, fx, fy, cx, cy)] * count, None, words, options)


def clip_cameras(cameras: list[Camera], poses: str | None, focal: str, options: ClipOptions) -> ClipCameras:
    """What the user wishes comes first, then what the clip says of its poses, in words; None: nothing."""
    if options.poses == "auto" and poses is not None:
        return ClipCameras(cameras, "given", {"poses": poses, "focal": focal})
    still: list[Camera] = []
    for camera in cameras:
        same = still and (camera.fx, camera.fy) == (still[-1].fx, still[-1].fy)
        still.append(still[-1] if same else replace(camera, viewmat=np.eye(4)))
    if options.poses == "still":
        return ClipCameras(still, "given", {"poses": "the camera stands still, as set", "focal": focal})
    words = "training looks whether it moves" if options.poses == "auto" else "training estimates how it moves, as set"
    return ClipCameras(still, options.poses, {"poses": f"assumed: the camera stands still; {words}", "focal": focal})


def llff_viewmats(poses: np.ndarray, axes: str = "llff") -> np.ndarray:
    """World-to-camera matrices (OpenCV axes), float64 [N, 4, 4], of camera-to-world poses [R | t], float [N, 3, 4]; the first is identity.

    The columns of R are the camera's down, right and back axes in the world ("llff"), or right, down and forward ("opencv").
    """
    columns = np.moveaxis(poses[:, :, :3], 2, 0)
    right, down, forward = (columns[1], columns[0], -columns[2]) if axes == "llff" else columns
    to_world = np.tile(np.eye(4), (len(poses), 1, 1))
    to_world[:, :3, :3] = np.stack([right, down, forward], axis=2)
    to_world[:, :3, 3] = poses[:, :, 3]
    return np.linalg.inv(to_world) @ to_world[0]


def llff_cameras(path: Path, count: int, size: tuple[int, int], options: ClipOptions) -> ClipCameras:
    """Cameras from `poses_bounds.npy`: [N, 17] rows of 3 × 5 [R | t | (height, width, focal)] and near, far.

    Rows that agree mean a camera that stands still. Focal lengths are scaled when the pictures are smaller or larger than the file says.
    ClipError for a file that does not fit.
    """
    rows = open_npy(path)
    if rows.ndim != 2 or rows.shape[1] != 17:
        raise ClipError(f"{shown(path)} has shape {list(rows.shape)}, but must be [frames, 17].")
    if len(rows) != count:
        raise ClipError(f"{shown(path)} has {len(rows)} rows, but there are {count} frames; each frame needs one.")
    table = np.array(rows[:, :15], np.float64).reshape(count, 3, 5)
    if not np.isfinite(table).all():
        raise ClipError(f"{shown(path)} holds values that are not finite.")
    check_rotations(table[:, :, :3], path)
    height, width, focal = table[:, 0, 4], table[:, 1, 4], table[:, 2, 4]
    if options.focal:
        focal, words = np.full(count, options.focal), f"{options.focal:g} pixels, as set"
    else:
        if (focal <= 0).any() or (height <= 0).any() or (width <= 0).any():
            raise ClipError(f"{shown(path)} has a height, width or focal length that is not positive; set focal instead.")
        scale = size[0] / width
        if np.abs(scale * height / size[1] - 1).max() > 0.02:
            raise ClipError(
                f"{shown(path)} is for {width[0]:g} × {height[0]:g} pixels, but the frames are {size[0]} × {size[1]}; set focal instead."
            )
        focal = focal * scale
        words = f"{focal[0]:.6g} pixels, from {path.name}" + (
            "" if np.allclose(scale, 1) else f", scaled from {width[0]:g} pixels of width"
        )
    if np.allclose(table[:, :, :4], table[0, :, :4], atol=1e-9):
        viewmats, poses = np.tile(np.eye(4), (count, 1, 1)), f"the camera stands still, from {path.name}"
    else:
        columns = "down, right, back" if options.pose_axes == "llff" else "right, down, forward"
        viewmats = llff_viewmats(table[:, :, :4], options.pose_axes)
        poses = f"the camera moves, from {path.name} (columns read as {columns}; set pose_axes to change)"
    return clip_cameras(_cameras(viewmats, size, focal, focal, size[0] / 2, size[1] / 2), poses, words, options)


def json_cameras(path: Path, count: int, size: tuple[int, int], options: ClipOptions) -> ClipCameras:
    """Cameras from `camera.json`: `width`, `height`, `fx`, `fy`, `cx`, `cy` and at will `viewmats` [frames][4][4].

    Without `viewmats` the clip says nothing of its poses. ClipError for a file that does not fit.
    """
    data = read_json(path)
    numbers = {}
    for key in ("width", "height", "fx", "fy", "cx", "cy"):
        value = data.get(key) if isinstance(data, dict) else None
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise ClipError(f"{shown(path)} needs a number '{key}'.")
        numbers[key] = float(value)
    if (numbers["width"], numbers["height"]) != size:
        raise ClipError(
            f"{shown(path)} is for {numbers['width']:g} × {numbers['height']:g} pixels, but the frames are {size[0]} × {size[1]}."
        )
    if numbers["fx"] <= 0 or numbers["fy"] <= 0:
        raise ClipError(f"{shown(path)} has a focal length that is not positive.")
    viewmats, poses = np.tile(np.eye(4), (count, 1, 1)), None
    if data.get("viewmats") is not None:
        try:
            viewmats = np.array(data["viewmats"], np.float64)
        except (ValueError, TypeError, OverflowError) as error:
            raise ClipError(f"{shown(path)}: 'viewmats' is not a list of 4 × 4 matrices.") from error
        if viewmats.shape != (count, 4, 4):
            raise ClipError(f"{shown(path)}: 'viewmats' has shape {list(viewmats.shape)}, but must be [{count}, 4, 4], one matrix a frame.")
        if not np.isfinite(viewmats).all() or not np.allclose(viewmats[:, 3], [0, 0, 0, 1]):
            raise ClipError(f"{shown(path)}: 'viewmats' holds a matrix that is no rigid map.")
        check_rotations(viewmats[:, :3, :3], path)
        moves = not np.allclose(viewmats, viewmats[0], atol=1e-9)
        poses = f"the camera {'moves' if moves else 'stands still'}, from {path.name}"
    fx, fy = (options.focal, options.focal) if options.focal else (numbers["fx"], numbers["fy"])
    cameras = _cameras(viewmats, size, np.full(count, fx), np.full(count, fy), numbers["cx"], numbers["cy"])
    return clip_cameras(cameras, poses, f"{fx:.6g} pixels, " + ("as set" if options.focal else f"from {path.name}"), options)


def json_unit(path: Path) -> str:
    """The name of the length that depth and poses beside `camera.json` are in: its `unit`, "scene units" when it names none."""
    unit = read_json(path).get("unit", "scene units")
    if not isinstance(unit, str) or not 1 <= len(unit) <= 20 or not unit.isprintable():
        raise ClipError(f"{shown(path)}: 'unit' must be the short name of a length, such as \"mm\".")
    return unit


def check_rotations(rotations: np.ndarray, path: Path) -> None:
    rotations = np.clip(rotations, -2, 2)  # what is cut off is no rotation either, and its products are numbers
    wrong = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max(axis=(1, 2)) > 1e-2
    wrong |= np.linalg.det(rotations) < 0
    if wrong.any():
        raise ClipError(f"{shown(path)}: the pose of frame {int(np.argmax(wrong))} is no rotation.")


def _cameras(viewmats: np.ndarray, size: tuple[int, int], fx: np.ndarray, fy: np.ndarray, cx: float, cy: float) -> list[Camera]:
    """One camera a frame; one object for all that agree with the frame before."""
    cameras: list[Camera] = []
    for i in range(len(viewmats)):
        same = i > 0 and fx[i] == fx[i - 1] and fy[i] == fy[i - 1] and np.array_equal(viewmats[i], viewmats[i - 1])
        cameras.append(cameras[-1] if same else Camera(*size, float(fx[i]), float(fy[i]), cx, cy, viewmats[i].copy()))
    return cameras
