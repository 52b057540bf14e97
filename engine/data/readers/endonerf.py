"""The EndoNeRF layout: `images/`, `masks/` or `gt_masks/`, `depth/` or `monodepth/`, `poses_bounds.npy`.

EndoGaussian, Deform3DGS, SurgicalGaussian and G-SHARP share it; SurgTPGS's CholecSeg8k has masks of the opposite polarity and no poses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.numbered import regular_file
from degense.engine.data.files.poses import Found, guessed_cameras, llff_cameras
from degense.engine.data.readers.folder import open_folder


def open_endonerf(path: Path, options: ClipOptions) -> Clip:
    """Open a clip in the EndoNeRF layout.

    Raises
    ------
    ClipError
    """

    def cameras(count: int, size: tuple[int, int], field: np.ndarray | None) -> Found:
        poses = path / "poses_bounds.npy"
        if poses.exists():
            return llff_cameras(regular_file(poses, path), count, size, options)
        return guessed_cameras(count, size, field, options)

    return open_folder(path, options, cameras, clip_depth=True)
