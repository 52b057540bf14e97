"""Gaussian PLY in the layout that viewers of static splats read (x y z, f_dc, opacity logit, log scales, quaternion wxyz)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from degense.engine.errors import RunError
from degense.engine.files import replacing
from degense.engine.splats import Splats

SH0 = 0.28209479177387814  # Y_0^0: colour = 0.5 + SH0 · f_dc
PROPERTIES = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")
MAX_VERTICES = 50_000_000


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


def load_ply(path: Path) -> Splats:
    """Read such a PLY; extra float properties are skipped. RunError for anything else, before memory is taken for it."""
    with path.open("rb") as file:
        if file.readline().strip() != b"ply" or file.readline().strip() != b"format binary_little_endian 1.0":
            raise RunError(f"{path} is not a binary little-endian PLY")
        names: list[str] = []
        count = -1
        for _ in range(512):
            words = file.readline(256).split()
            if words[:1] == [b"end_header"]:
                break
            if words[:2] == [b"element", b"vertex"] and len(words) == 3 and words[2].isdigit():
                count = int(words[2])
            elif words[:2] == [b"property", b"float"] and len(words) == 3:
                names.append(words[2].decode("ascii", "replace"))
            elif words[:1] not in ([b"comment"],):
                raise RunError(f"{path} has a header line that splats do not have: {b' '.join(words)[:60]!r}")
        else:
            raise RunError(f"{path} has no end to its header")
        missing = set(PROPERTIES) - set(names)
        if missing:
            raise RunError(f"{path} lacks {', '.join(sorted(missing))}, so it does not hold Gaussians")
        size = path.stat().st_size - file.tell()
        if not 0 <= count <= MAX_VERTICES or size < count * len(names) * 4:
            raise RunError(f"{path} is shorter than its header says ({count} vertices)")
        rows = np.frombuffer(file.read(count * len(names) * 4), "<f4").reshape(count, len(names))
    table = torch.from_numpy(rows[:, [names.index(name) for name in PROPERTIES]].copy())
    return Splats(table[:, :3], table[:, 10:14], table[:, 7:10].exp(), table[:, 6].sigmoid(), table[:, 3:6] * SH0 + 0.5, table[:, :0])
