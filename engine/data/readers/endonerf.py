"""The layout endonerf: `images/`, `masks/` or `gt_masks/`, `depth/` or `monodepth/`, and cameras in `poses_bounds.npy`.

EndoGaussian, Deform3DGS, SurgicalGaussian and G-SHARP share it; SurgTPGS's CholecSeg8k has masks of the opposite polarity and no poses.
"""

from __future__ import annotations

from pathlib import Path

from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import llff_cameras
from degense.engine.data.readers.frame_folder import open_folder


def open_endonerf(path: Path, options: ClipOptions) -> Clip:
    """Open a clip in this layout. ClipError when it cannot be read."""
    return open_folder(path, options, path / "poses_bounds.npy", llff_cameras, clip_depth=True)
