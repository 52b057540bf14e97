"""Damaged inputs for everything that reads: each is read or refused in one sentence, within bounds of time and memory, or stands here.

Half of them are damaged once. The others are inputs that led the program to steps that it had not taken before, damaged once more.
"""

from __future__ import annotations

import os
import random
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from degense.app.research.reliability.guarded import READ, guarded
from degense.app.research.reliability.mutate import OUTSIDE, mutated
from degense.app.research.reliability.readers import Reader
from degense.app.research.reliability.steps import steps_in, traced
from degense.app.research.reliability.tally import Tally
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent

SECONDS, MEBIBYTES = 10.0, 1024
LINKED = 1 << 20  # bytes from which a file is linked instead of copied
#: The share of inputs that are made by damaging further what led to new steps of the program, of less than so many bytes.
FURTHER, KEPT = 0.5, 1 << 20
COUNT, QUICK_COUNT = 20_000, 400


def tallies(chosen: Sequence[Reader], count: int, scratch: Path, seed: int, progress: Progress = silent) -> Iterator[Tally]:
    """Damage `count` inputs, as many of each reader, and read them. DegenseError when a sound one cannot be read."""
    for number, reader in enumerate(chosen):
        share = count * (number + 1) // len(chosen) - count * number // len(chosen)

        def tell(done: float, number: int = number, name: str = reader.name) -> None:
            progress((number + done) / len(chosen), name)

        yield tally(reader, share, scratch / f"{number:02d}", seed, tell)


def tally(reader: Reader, count: int, scratch: Path, seed: int, progress: Callable[[float], None] = lambda done: None) -> Tally:
    """Damage `count` inputs of one reader. `scratch` is made, and taken away again."""
    at, record, rng = scratch / "at", scratch / "steps", random.Random(f"{seed} {reader.name}")
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
        fate = guarded(partial(traced, partial(_inside, at, reader.read, path), record), SECONDS, MEBIBYTES)
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
        progress((case + 1) / count)
    shutil.rmtree(scratch)
    found.steps = len(steps)
    return found


def _made(reader: Reader, scratch: Path) -> tuple[Path, Path]:
    """The path that the reader is told, and the folder in which its sound sample is kept; the path is below a copy of that folder, `at`."""
    at, whole, where = scratch / "at", scratch / "whole", scratch / "where"
    at.mkdir(parents=True)
    # Not here: a process that has drawn or computed with several threads cannot be forked.
    made = guarded(lambda: where.write_text(str(reader.make(at)), encoding="utf-8"), 600, 16 << 10)
    if made.outcome != READ:
        raise DegenseError(f"The sound sample of {reader.name} cannot be made: {made.outcome} {made.words}")
    at.rename(whole)
    return Path(where.read_text(encoding="utf-8")), whole


def _inside(folder: Path, read: Callable[[Path], object], path: Path) -> None:
    """Read, and be at fault where what damaged inputs name outside of their folder was opened, by whatever name leads there."""
    opened: list[str] = []

    def hear(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and str(arguments[0]).endswith(OUTSIDE):
            opened.append(os.path.realpath(str(arguments[0])))

    sys.addaudithook(hear)  # of this process, which is a fork
    try:
        read(path)
    finally:
        left = [name for name in opened if not Path(name).is_relative_to(folder.resolve())]
        assert not left, f"{left[0]} was opened, which lies outside of the input"


def _linked(source: str, target: str) -> None:
    """Copy a file, or link a large one: nothing writes into one that is there."""
    (os.link if os.stat(source).st_size > LINKED else shutil.copyfile)(source, target)
