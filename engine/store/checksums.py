"""Check sums of a finished run, in the form that `sha256sum -c` reads: a run that was changed since is found, and they can be signed."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from degense.engine import untrusted
from degense.engine.errors import RunError
from degense.engine.files import write_text
from degense.engine.store.files import MAX_BYTES
from degense.engine.store.run import Run

SUMS = "SHA256SUMS"
#: What a training leaves and nothing writes afterwards; a session, annotations and previews are the user's.
TRAINED = (
    "run.json",
    "model.safetensors",
    "observability.safetensors",
    "label_support.safetensors",
    "basis.safetensors",
    "text_vectors.safetensors",
    "metrics.jsonl",
)
MOST_BYTES = 1 << 16
LINE = re.compile(r"([0-9a-f]{64})  ([\w.]+)")


def write_checksums(folder: Path) -> tuple[str, ...]:
    """Write `SHA256SUMS` into a run folder; the names in it. RunError for a run that is not finished."""
    run = Run.open(folder)
    if run.info["state"] != "finished":
        raise RunError(f"{folder} is not finished (its training is {run.info['state']}), so its files still change; resume it first.")
    sums = {name: _sum(folder / name) for name in TRAINED if (folder / name).exists()}
    write_text(folder / SUMS, "".join(f"{digest}  {name}\n" for name, digest in sums.items()))
    return tuple(sums)


def check_checksums(folder: Path) -> tuple[str, ...]:
    """The names of the files that are as `SHA256SUMS` says: all. RunError when one was changed, is gone, or came later."""
    try:
        text = untrusted.read_bytes(folder / SUMS, MOST_BYTES).decode("ascii")
    except FileNotFoundError as error:
        raise RunError(f"{folder} holds no {SUMS}; write it with degense checksum {folder}") from error
    except (OSError, ValueError) as error:
        raise RunError(f"{folder / SUMS} cannot be read: {error}") from error
    lines = [LINE.fullmatch(line) for line in text.splitlines()]
    said = {line[2]: line[1] for line in lines if line is not None}
    if len(said) < len(lines) or not set(said) <= set(TRAINED) or not said:
        raise RunError(f"{folder / SUMS} holds no check sums of a run; write it anew with degense checksum {folder}")
    there = [name for name in TRAINED if (folder / name).exists()]
    wrong = [f"{name} is gone" for name in said if name not in there]
    wrong += [f"{name} came later" for name in there if name not in said]
    wrong += [f"{name} is another" for name in there if name in said and _sum(folder / name) != said[name]]
    if wrong:
        raise RunError(f"{folder} is not the run that {SUMS} was made of: {', '.join(wrong)}.")
    return tuple(said)


def _sum(path: Path) -> str:
    """SHA-256 of a file, as hexadecimal digits."""
    try:
        untrusted.check_regular(path, MAX_BYTES)
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
    except (OSError, ValueError) as error:
        raise RunError(f"{path} cannot be read: {error}") from error
    return digest.hexdigest()
