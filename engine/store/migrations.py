"""What runs of earlier versions lack, or have beside ours."""

from __future__ import annotations

from typing import Any

import torch

GONE = {"flow_final"}  # settings of trainings


def with_drifts(tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Tensors of a model; in those of a version without drifts nothing drifts."""
    means = tensors.get("canonical.means")
    return tensors if means is None else {"canonical.drifts": torch.zeros_like(means), **tensors}


def without_gone(settings: dict[str, Any]) -> dict[str, Any]:
    """A run's settings without those that no longer exist."""
    return {name: value for name, value in settings.items() if name not in GONE}
