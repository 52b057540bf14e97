"""Damaged inputs for everything that reads: each is read or refused in one sentence, within bounds of time and memory, or stands here.

Half of them are damaged once. The others are inputs that led the program to steps that it had not taken before, damaged once more.
"""

from __future__ import annotations

import importlib
import json
import os
import random
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from degense.app.research.reliability.damage.mutate import mutated
from degense.app.research.reliability.guarded import READ, guarded
from degense.app.research.reliability.readers.reader import Reader
from degense.app.research.reliability.steps import steps_in, traced
from degense.app.research.reliability.tally import Tally
from degense.app.research.reliability.watch import watched
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent
from degense.engine.vocabulary.concepts import surgical_vocabulary

SECONDS, MEBIBYTES = 10.0, 1024
LINKED = 1 << 20  # bytes from which a file is linked instead of copied
#: The share of inputs that are made by damaging further what led to new steps of the program, of less than so many bytes.
FURTHER, KEPT = 0.5, 1 << 20
COUNT, QUICK_COUNT = 20_000, 400


def tallies(
    chosen: Sequence[Reader], count: int, scratch: Path, seed: int, progress: Progress = silent, log: Path | None = None
) -> Iterator[Tally]:
    """Damage `count` inputs, as many of each reader, and read them; each reader's row is a line of `log` as soon as it is there.

    DegenseError when a sound one cannot be read.
    """
    for number, reader in enumerate(chosen):
        share = count * (number + 1) // len(chosen) - count * number // len(chosen)

        def tell(done: float, number: int = number, name: str = reader.name) -> None:
            progress((number + done) / len(chosen), name)

        found = tally(reader, share, scratch / f"{number:02d}", seed, tell)
        if log is not None:
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(found.row()) + "\n")
        yield found


def tally(reader: Reader, count: int, scratch: Path, seed: int, progress: Callable[[float], None] = lambda done: None) -> Tally:
    """Damage `count` inputs of one reader. `scratch` is made, and taken away again."""
    scratch = scratch.resolve()
    at, own, record, rng = scratch / "at", scratch / "own", scratch / "steps", random.Random(f"{seed} {reader.name}")
    path, whole = _made(reader, scratch)
    files = [sorted(file.relative_to(whole) for file in whole.glob(pattern) if file.is_file()) for pattern in reader.spoilt]
    if not any(files):
        raise DegenseError(f"There is nothing to damage in the sample of {reader.name}.")
    found, steps = Tally(reader.name), set[int]()
    further: list[dict[Path, bytes]] = [{}]  # what was changed in the inputs that went where none went before
    for case in range(-1, count):
        shutil.copytree(whole, at, copy_function=_linked)
        changed, words = dict[Path, bytes](), "sound"
        if case >= 0:
            changed = dict(rng.choice(further)) if rng.random() < FURTHER else {}
            chosen = rng.choice(rng.choice([some for some in files if some]))
            words = f"case {case}, {chosen}"
            changed[chosen] = mutated(changed.get(chosen, (whole / chosen).read_bytes()), chosen.name, rng)
        for name, data in changed.items():
            (at / name).unlink()
            (at / name).write_bytes(data)
        fate = guarded(partial(traced, partial(watched, reader.read, path, at, own), record), SECONDS, MEBIBYTES)
        if case < 0 and fate.outcome != READ:
            raise DegenseError(f"The sound sample of {reader.name} cannot be read: {fate.outcome} {fate.words}")
        if case >= 0:
            found.add(fate, words)
        taken = steps_in(record)
        if taken - steps and sum(map(len, changed.values())) < KEPT:
            further.append(changed)
        steps |= taken
        record.unlink(missing_ok=True)
        shutil.rmtree(at)
        shutil.rmtree(own, ignore_errors=True)
        progress((case + 1) / count)
    shutil.rmtree(scratch)
    found.steps = len(steps)
    return found


def _made(reader: Reader, scratch: Path) -> tuple[Path, Path]:
    """The path that the reader is told, and the folder in which its sound sample is kept; the path is below a copy of that folder, `at`.

    What reading it imports is imported here, once, so that forks have it.
    """
    at, whole, about = scratch / "at", scratch / "whole", scratch / "about"
    at.mkdir(parents=True)

    def make() -> None:
        path = reader.make(at)
        shutil.copytree(at, whole)
        with suppress(Exception):  # that it cannot be read is told later
            reader.read(path)
        about.write_text(json.dumps([str(path), *sys.modules]), encoding="utf-8")

    # Not here: a process that has drawn or computed with several threads cannot be forked.
    made = guarded(make, 600, 16 << 10)
    if made.outcome != READ:
        raise DegenseError(f"The sound sample of {reader.name} cannot be made: {made.outcome} {made.words}")
    shutil.rmtree(at)
    path, *modules = json.loads(about.read_text(encoding="utf-8"))
    for name in modules:
        with suppress(Exception):  # some are no modules of their own
            importlib.import_module(name)
    surgical_vocabulary()  # here, not in each fork again
    return Path(path), whole


def _linked(source: str, target: str) -> None:
    """Copy a file, or link a large one: nothing writes into one that is there."""
    (os.link if os.stat(source).st_size > LINKED else shutil.copyfile)(source, target)
