"""Gaussian PLY in the layout that viewers of static splats read: x y z, f_dc, opacity logit, log scales, quaternion wxyz."""

from __future__ import annotations

from pathlib import Path

import torch

from degense.engine.files import replacing
from degense.engine.splats import Splats

SH0 = 0.28209479177387814  # Y_0^0: colour = 0.5 + SH0 · f_dc
PROPERTIES = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")


def save_ply(path: Path, splats: Splats) -> None:
    """Write one instant as a binary little-endian PLY. Semantics are not part of this layout."""
    opacity = splats.opacities.clamp(1e-6, 1 - 1e-6)
    columns = torch.cat(
        [splats.means, (splats.colors - 0.5) / SH0, torch.logit(opacity)[:, None], splats.scales.clamp_min(1e-12).log(), splats.quats], 1
    )
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            f"element vertex {len(splats)}",
            *(f"property float {name}" for name in PROPERTIES),
            "end_header\n",
        ]
    )
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(columns.detach().cpu().numpy().astype("<f4").tobytes())
