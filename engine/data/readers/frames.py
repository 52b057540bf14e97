"""Loose frames: pictures in a folder or in its `images/`.

Beside them may lie `masks/`, `depth/`, `labels/` with `classes.json`, `camera.json`, and `gt.npz`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.numbered import regular_file
from degense.engine.data.files.poses import Found, guessed_cameras, json_cameras, json_unit
from degense.engine.data.readers.folder import open_folder


def open_frames(path: Path, options: ClipOptions) -> Clip:
    """Open a folder of frames.

    Raises
    ------
    ClipError
    """

    def cameras(count: int, size: tuple[int, int], field: np.ndarray | None) -> Found:
        camera = path / "camera.json"
        if camera.exists():
            return json_cameras(regular_file(camera, path), count, size, options)
        return guessed_cameras(count, size, field, options)

    clip = open_folder(path, options, cameras, clip_depth=False)
    if (path / "camera.json").exists() and clip.depth_measured:
        clip.unit = json_unit(regular_file(path / "camera.json", path))
    return clip
