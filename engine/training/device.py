"""Where tensors live."""

from __future__ import annotations

import torch

from degense.engine.errors import DegenseError


def choose_device(name: str) -> torch.device:
    """`auto` takes a GPU when there is one. DegenseError when `cuda` is asked for and absent."""
    if name not in ("auto", "cpu", "cuda"):
        raise DegenseError(f"there is no device {name!r}; choose auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise DegenseError("no CUDA GPU was found; train with --device cpu, or see degense doctor")
    return torch.device("cuda" if name == "cuda" or (name == "auto" and torch.cuda.is_available()) else "cpu")
