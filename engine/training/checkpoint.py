"""Checkpoints: the whole state of a trainer in one safetensors file and one JSON file, written whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from degense.engine.errors import RunError, what_is_wrong
from degense.engine.store.files import finite, read_json, read_tensors, write_json, write_tensors
from degense.engine.store.migrations import current_consensus, current_progress, current_tensors

PARTS = ("model", "moments", "density", "neighbours", "consensus")


def save_checkpoint(folder: Path, state: dict[str, Any]) -> None:
    """Write `state` (see `Trainer.state`) as `last.safetensors`.

    The JSON side names the tensors' step, so that a pair that does not belong together is noticed.
    """
    tensors = {f"{part}/{name}": value for part in PARTS for name, value in state[part].items()}
    tensors["generator"] = state["generator"]
    step = state["plain"]["iteration"]
    write_tensors(folder / f"step-{step:07d}.safetensors", tensors)
    write_json(folder / "last.json", state["plain"])
    for old in folder.glob("step-*.safetensors"):
        if old.name != f"step-{step:07d}.safetensors":
            old.unlink()


def load_checkpoint(folder: Path) -> dict[str, Any]:
    """The last state saved in `folder`. RunError when there is none or it is damaged."""
    plain = read_json(folder / "last.json", 1 << 128)  # the states of random generators have so many bits
    if not isinstance(plain, dict) or not isinstance(plain.get("iteration"), int):
        raise RunError(f"{folder / 'last.json'} is not a checkpoint of ours")
    path = folder / f"step-{plain['iteration']:07d}.safetensors"
    tensors = finite(read_tensors(path), path)
    state: dict[str, Any] = {part: {} for part in PARTS} | {"generator": tensors.pop("generator", None)}
    if state["generator"] is None:
        raise RunError(f"{path} is not a checkpoint of ours")
    for name, value in tensors.items():
        part, _, rest = name.partition("/")
        if part not in PARTS:
            raise RunError(f"{path} holds {name!r}, which no checkpoint of ours does")
        state[part][rest] = value
    try:
        state["plain"] = current_progress(plain)
        state["model"] = current_tensors(state["model"])
        state["moments"] = current_tensors(state["moments"])
        state["consensus"] = current_consensus(state["consensus"])
    except (LookupError, TypeError, RuntimeError) as error:
        raise RunError(f"{folder / 'last.json'} is damaged ({what_is_wrong(error)})") from error
    return state
