"""Pictures with the cameras of a `transforms.json`, as Nerfstudio and instant-ngp write it.

Poses are camera-to-world, x right, y up, z back. Lens distortion of the model OPENCV is taken out of the pictures.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.images import picture_size
from degense.engine.data.files.numbered import PICTURES, read_json, regular_file, shown
from degense.engine.data.files.posed_frames import Lens, PosedFrame, open_posed
from degense.engine.errors import ClipError

NAME = "transforms.json"
LENSES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE")
DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # from y up, z back to y down, z forward


def is_nerfstudio(folder: Path) -> bool:
    return (folder / NAME).is_file()


def open_nerfstudio(path: Path, options: ClipOptions) -> Clip:
    """Open the pictures that the file lists. ClipError when they, or it, cannot be read."""
    source = regular_file(path / NAME, path)
    data = read_json(source)
    listed = data.get("frames") if isinstance(data, dict) else None
    if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
        raise ClipError(f"{shown(source)} has no list of 'frames'.")
    frames = []
    for entry in listed:
        file = _picture(path, entry.get("file_path"), source)
        try:
            pose = np.array(entry.get("transform_matrix"), np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise ClipError(f"{shown(source)}: 'transform_matrix' of {file.name} is no matrix.") from error
        if pose.shape != (4, 4) or not np.isfinite(pose).all() or not np.allclose(pose[3], [0, 0, 0, 1]):
            raise ClipError(f"{shown(source)}: 'transform_matrix' of {file.name} is no rigid 4 × 4 matrix.")
        rigid = abs(np.linalg.det(pose[:3, :3])) > 1e-6
        viewmat = np.linalg.inv(pose @ FLIP) if rigid else np.full((4, 4), 0.0)
        frames.append(PosedFrame(file, viewmat, _lens({**data, **entry}, file, source)))
    return open_posed(path, frames, source, options)


def _picture(path: Path, name: Any, source: Path) -> Path:
    """The picture of a name, which may lack its suffix, as instant-ngp has it."""
    if not isinstance(name, str) or not name.isprintable() or not 0 < len(name) < 1000:
        raise ClipError(f"{shown(source)}: a frame has no 'file_path'.")
    file = path / name
    if not file.suffix:
        file = next((other for suffix in PICTURES if (other := file.with_suffix(suffix)).is_file()), file)
    return regular_file(file, path)


def _lens(values: dict[str, Any], file: Path, source: Path) -> Lens:
    """From `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, of the frame or of all, or from `camera_angle_x`."""
    if (model := values.get("camera_model", LENSES[0])) not in LENSES:
        raise ClipError(f"{shown(source)} has the camera model {str(model)[:40]!r}; undistort the pictures first, or use {LENSES[0]}.")
    found = {name: values[name] for name in ("fl_x", "fl_y", "cx", "cy", "w", "h", "camera_angle_x", *DISTORTION) if name in values}
    if not all(isinstance(value, (int, float)) and math.isfinite(value) for value in found.values()):
        raise ClipError(f"{shown(source)} has a lens with numbers that are none.")
    size = (int(found["w"]), int(found["h"])) if {"w", "h"} <= set(found) else picture_size(file)
    fx = found.get("fl_x")
    if fx is None and 0 < found.get("camera_angle_x", 0.0) < math.pi:
        fx = size[0] / 2 / math.tan(found["camera_angle_x"] / 2)
    if fx is None:
        raise ClipError(f"{shown(source)} needs the focal length 'fl_x' or the angle 'camera_angle_x'.")
    bends = [float(found.get(name, 0.0)) for name in DISTORTION]
    distortion = tuple(bends) if any(bends) else ()
    return Lens(
        *size, float(fx), float(found.get("fl_y", fx)), float(found.get("cx", size[0] / 2)), float(found.get("cy", size[1] / 2)), distortion
    )
