"""JSON and tensors on disk: whole or absent, and checked before they are used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from degense.engine import untrusted
from degense.engine.errors import RunError
from degense.engine.files import replacing, write_text

MAX_BYTES, MAX_JSON = 8 << 30, 64 << 20


def write_json(path: Path, values: Any) -> None:
    write_text(path, json.dumps(values, indent=1))


def read_json(path: Path, greatest: int = untrusted.GREATEST) -> Any:
    """The values of a JSON file of at most 64 MB. Raises RunError in one sentence otherwise.

    `greatest` is the largest whole number that may be in it.
    """
    try:
        return untrusted.read_json(path, MAX_JSON, greatest)
    except FileNotFoundError as error:
        raise RunError(f"{path} is missing, so this is not a complete run") from error
    except (OSError, ValueError) as error:
        raise RunError(f"{path} cannot be read: {error}") from error


def write_tensors(path: Path, tensors: dict[str, Tensor]) -> None:
    """Save tensors as safetensors, whole or not at all."""
    with replacing(path) as temporary:
        try:
            save_file({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, str(temporary))
        except SafetensorError as error:
            raise RunError(f"{path} could not be saved: {error}") from error


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Tensors of a safetensors file.

    The format holds no code; header and sizes are checked against the file's length before anything is allocated.
    """
    try:
        untrusted.check_regular(path, MAX_BYTES)
        with safe_open(str(path), framework="pt") as file:
            return {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - a handle, not a dict
    except FileNotFoundError as error:
        raise RunError(f"{path} is missing, so this is not a complete run") from error
    except (OSError, ValueError, SafetensorError) as error:
        raise RunError(f"{path} is damaged or not a safetensors file: {error}") from error


def finite(tensors: dict[str, Tensor], path: Path) -> dict[str, Tensor]:
    """`tensors`, or RunError when one of them holds NaN or infinity."""
    for name, tensor in tensors.items():
        if tensor.is_floating_point() and not bool(torch.isfinite(tensor).all()):
            raise RunError(f"{path}: {name} holds values that are not numbers; the file is damaged")
    return tensors
