"""What runs of earlier versions lack."""

from __future__ import annotations

import torch


def with_drifts(tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Tensors of a model; in those of a version without drifts nothing drifts."""
    means = tensors.get("canonical.means")
    return tensors if means is None else {"canonical.drifts": torch.zeros_like(means), **tensors}
