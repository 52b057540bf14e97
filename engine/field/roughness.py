"""How rough planes and curves over time are: means of differences between neighbours, which regularizers keep small."""

from __future__ import annotations

import torch
from torch import Tensor

from degense.engine.field import roughness_cpu
from degense.engine.field.roughness_cpu import ACROSS, ALONG, APART, BEND

__all__ = ["ACROSS", "ALONG", "APART", "BEND", "plain_roughness", "roughness"]


def roughness(values: Tensor, *kinds: int, centre: float = 0.0) -> list[Tensor]:
    """Means over values [A, Y, X, C] of the `kinds` that are asked for, in that order.

    `ALONG`: squared differences of neighbours along X; `ACROSS`: along Y; `BEND`: squared second differences along Y; `APART`:
    |value − `centre`|. Where there is nothing to take a difference of, it is 0.
    """
    fused = values.device.type == "cpu" and values.dtype == torch.float32
    means = (roughness_cpu.roughness if fused else plain_roughness)(values, kinds, centre).unbind()
    return [means[kind] for kind in kinds]


def plain_roughness(values: Tensor, kinds: tuple[int, ...], centre: float) -> Tensor:
    """The four kinds, [4], 0 for those that are not asked for; in plain torch, any device and precision."""
    zero = values.new_zeros(())
    find = {
        ALONG: lambda: values.diff(dim=2).square(),
        ACROSS: lambda: values.diff(dim=1).square(),
        BEND: lambda: values.diff(n=2, dim=1).square(),
        APART: lambda: (values - centre).abs(),
    }
    found = {kind: find[kind]() for kind in kinds}
    return torch.stack([found[kind].mean() if kind in found and found[kind].numel() else zero for kind in range(4)])
