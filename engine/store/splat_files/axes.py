"""Axes of other tools. Ours are x right, y down, z forward; those of OpenGL, glTF and SPZ are x right, y up, z back."""

from __future__ import annotations

import torch

from degense.engine.splats import Splats


def right_up_back(splats: Splats) -> Splats:
    """The Gaussians turned by 180° about x, from our axes to those of OpenGL; quaternions have unit length."""
    signs = splats.means.new_tensor([1.0, -1.0, -1.0])
    quats = torch.nn.functional.normalize(splats.quats, dim=1) * splats.quats.new_tensor([1.0, 1.0, -1.0, -1.0])
    return Splats(splats.means * signs, quats, splats.scales, splats.opacities, splats.colors, splats.semantics)
