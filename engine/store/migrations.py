"""What runs of earlier versions call otherwise, lack, or have beside ours. Every reader of a run goes through these functions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

#: Settings of trainings, and tensors of models, that have other names now.
SETTINGS = {
    "recolour": "delta_color",
    "resemantics": "delta_semantics",
    "tint": "color_residual",
    "tint_change": "color_residual_change",
    "rate_tints": "rate_color_residuals",
    "drifts": "velocities",
    "lasting": "persistent",
    "plane_still": "plane_static",
}
TENSORS = {
    "canonical.tints": "canonical.color_residuals",
    "canonical.drifts": "canonical.velocities",
    "canonical.lifetimes": "canonical.temporal_windows",
    "responses": "semantic_coefficients",
    "support": "observability",
}
#: Layers, and files of a run folder, that have other names now.
LAYERS = {"support": "observability"}
FILES = {"observability.safetensors": "support.safetensors"}
#: What a checkpoint says of a trainer's progress.
PROGRESS = {"caution": "rate_scale"}
#: Settings of trainings that no longer exist.
REMOVED = {"flow_final", "codebook", "fit", "early_stop", "early_stopping"}


def current_tensors(tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Tensors of a model, or of its moments, by the names of today; in models from before velocities, all velocities are zero."""
    renamed = {}
    for name, value in tensors.items():
        old = next((old for old in TENSORS if name == old or name.startswith(f"{old}.")), None)
        renamed[name if old is None else TENSORS[old] + name.removeprefix(old)] = value
    means = renamed.get("canonical.means")
    return renamed if means is None else {"canonical.velocities": torch.zeros_like(means), **renamed}


def current_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """A run's settings by the names of today, without those that no longer exist."""
    current = {SETTINGS.get(name, name): value for name, value in settings.items() if name not in REMOVED}
    return current | {"distillation": "clusters"} if settings.get("codebook") else current


def current_layer(name: str) -> str:
    """A layer by its name of today."""
    return LAYERS.get(name, name)


def existing_file(folder: Path, name: str) -> Path:
    """A file of a run folder, by the name of an earlier version where only that is there."""
    path, earlier = folder / name, folder / FILES.get(name, name)
    return earlier if earlier.exists() and not path.exists() else path


def current_consensus(consensus: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """A checkpoint's consensus of a teacher's frames (`engine.training.semantic.consensus.agreed_answers`), if it has one.

    Up to decision 48 the accuracy of the teacher was not found: it is taken to be right where it says what the consensus says.
    """
    return {"accuracy": 1 - consensus["disagreement"], **consensus} if consensus else {}


def current_progress(progress: dict[str, Any]) -> dict[str, Any]:
    """What a checkpoint says of a trainer's progress, by the names of today.

    A training that had stopped early (up to decision 32) goes on at the same place of its schedule: it stands as many steps later as it
    had left out.
    """
    current = {PROGRESS.get(name, name): value for name, value in progress.items()}
    skipped = current.pop("early", {"skipped": 0})["skipped"]
    return current | {"iteration": current["iteration"] + skipped}
