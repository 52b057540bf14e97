"""SPZ, version 3 (Niantic): a gzip stream of a header and the quantised attributes one after the other, a tenth of a PLY."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.files import replacing
from degense.engine.splats import Splats
from degense.engine.store.splat_files.axes import right_up_back
from degense.engine.store.splat_files.ply import SH0

MAGIC, VERSION = 0x5053474E, 3
#: Readers of SPZ refuse more.
MOST_GAUSSIANS = 10_000_000
#: Bits of a coordinate, signed, and those after the point where all coordinates leave room for them (as other writers have it).
COORDINATE_BITS, FRACTION_BITS = 24, 12
#: A byte of colour is 255 · (f_dc · COLOR_SCALE + ½), one of scale is 16 · (log scale + 10).
COLOR_SCALE, SCALE_STEPS, SCALE_OFFSET = 0.15, 16.0, 10.0


def save_spz(path: Path, splats: Splats) -> None:
    """Write one instant, without semantics. DegenseError for more Gaussians, or farther away, than the format holds."""
    if len(splats) > MOST_GAUSSIANS:
        raise DegenseError(f"SPZ holds at most {MOST_GAUSSIANS} Gaussians, and there are {len(splats)}; choose PLY.")
    turned = right_up_back(splats).detach().to("cpu")
    means = turned.means.numpy().astype(np.float64)
    bits = _fraction_bits(float(np.abs(means).max(initial=0.0)))
    fixed = (means * 2.0**bits).round().astype("<i4").reshape(-1, 1).view(np.uint8)[:, :3]
    colors = (turned.colors.numpy() - 0.5) / SH0 * COLOR_SCALE + 0.5
    scales = (np.log(turned.scales.clamp_min(1e-12).numpy()) + SCALE_OFFSET) * SCALE_STEPS
    header = struct.pack("<IIIBBBB", MAGIC, VERSION, len(splats), 0, bits, 0, 0)
    parts = (fixed, _bytes(turned.opacities.numpy() * 255), _bytes(colors * 255), _bytes(scales), _smallest_three(turned.quats.numpy()))
    with replacing(path) as temporary:
        temporary.write_bytes(gzip.compress(header + b"".join(part.tobytes() for part in parts), mtime=0))


def _fraction_bits(farthest: float) -> int:
    """How many bits of a coordinate lie after the point."""
    for bits in range(FRACTION_BITS, -1, -1):
        if farthest * 2**bits < 2 ** (COORDINATE_BITS - 1) - 1:
            return bits
    raise DegenseError(f"SPZ holds no Gaussian that lies {farthest:.3g} units away; choose PLY.")


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.asarray(values.round().clip(0, 255), np.uint8)


def _smallest_three(quats: np.ndarray) -> np.ndarray:
    """Unit quaternions wxyz [N, 4] as uint32 [N]: which of x, y, z, w is largest (2 bits), then sign and size (9 bits) of the others."""
    turned = quats[:, [1, 2, 3, 0]].astype(np.float64)
    largest = np.abs(turned).argmax(1)
    turned *= np.where(np.take_along_axis(turned, largest[:, None], 1) < 0, -1.0, 1.0)
    sizes = np.minimum(511, np.floor(np.abs(turned) * np.sqrt(2.0) * 511 + 0.5)).astype(np.uint32)
    fields = (turned < 0).astype(np.uint32) << np.uint32(9) | sizes
    packed: np.ndarray = largest.astype(np.uint32)
    for component in range(4):
        packed = np.where(largest == component, packed, packed << np.uint32(10) | fields[:, component])
    return np.asarray(packed, "<u4")
