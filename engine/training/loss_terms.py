"""The terms of the loss by name: weighted, added up, and their means for the record."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from operator import add
from typing import NamedTuple

import torch
from torch import Tensor

#: Terms by the part of a step that computes them. A term has the name of the setting that weighs it, where it has one of its own.
TERMS = {
    "deformation": ("shape", "displacement", "rigidity", "delta_color"),
    "frame": ("l1", "ssim", "depth"),
    "flow": ("flow",),
    "smoothness": ("plane_space", "plane_time", "plane_static", "color_residual", "color_residual_change"),
    "semantic": ("align", "region", "delta_semantics"),
}


class Loss(NamedTuple):
    """The loss of one part of a step."""

    total: Tensor  # float []; with its gradient
    terms: Tensor  # float [k]; the weighted terms that it is the sum of, in the order of `TERMS`, without gradient

    @classmethod
    def of(cls, part: str, terms: Mapping[str, Tensor], zero: Tensor) -> Loss:
        """The sum of weighted terms of a part, in the order of `TERMS`; those that are missing are `zero`, float []."""
        total = reduce(add, (terms[name] for name in TERMS[part] if name in terms), zero)
        return cls(total, torch.stack([terms.get(name, zero).detach() for name in TERMS[part]]))

    def times(self, weight: float | Tensor) -> Loss:
        """All of it `weight` times."""
        return Loss(self.total * weight, self.terms * weight)


class LossSums:
    """Sums of loss, squared error and terms since the last report, kept on the device so that no step waits for them."""

    def __init__(self, device: torch.device):
        self.totals = torch.zeros(2, device=device)
        self.terms = {part: torch.zeros(len(names), device=device) for part, names in TERMS.items()}

    def add(self, loss: Tensor, squared_error: Tensor, parts: Mapping[str, Loss]) -> None:
        """Count one step: its loss, the mean squared error of its frame, and the parts of the loss."""
        self.totals += torch.stack([loss.detach(), squared_error])
        for part, found in parts.items():
            self.terms[part] += found.terms

    def means(self, steps: int) -> tuple[float, float, dict[str, float]]:
        """Mean loss, squared error, and terms by name over so many steps; terms that had no part in the loss are left out. Forgets all."""
        loss, error, *terms = (torch.cat([self.totals, *self.terms.values()]) / max(steps, 1)).tolist()
        names = [name for part in TERMS.values() for name in part]
        self.zero_()
        return loss, error, {name: value for name, value in zip(names, terms, strict=True) if value != 0}

    def zero_(self) -> None:
        """Forget everything."""
        for sums in (self.totals, *self.terms.values()):
            sums.zero_()
