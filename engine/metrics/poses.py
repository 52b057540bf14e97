"""How far camera poses are off, against exact ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from degense.engine.camera import Camera


def pose_errors(estimated: Sequence[Camera], true: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray]:
    """Distance between the centres and angle between the rotations of every frame's cameras, float64 [T] each, clip units and degrees.

    Both start from the same first camera; nothing is aligned, neither place nor scale.
    """
    ours, theirs = (np.stack([camera.viewmat for camera in cameras]) for cameras in (estimated, true))
    centres = [-np.einsum("tji,tj->ti", views[:, :3, :3], views[:, :3, 3]) for views in (ours, theirs)]
    turns = Rotation.from_matrix(ours[:, :3, :3] @ theirs[:, :3, :3].transpose(0, 2, 1)).magnitude()
    return np.linalg.norm(centres[0] - centres[1], axis=1), np.degrees(turns)
