"""Damaged inputs for everything that reads: each is read or refused in one sentence, within bounds of time and memory, or stands here."""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from degense.app.research.reliability.guarded import READ, guarded
from degense.app.research.reliability.mutate import mutated
from degense.app.research.reliability.readers import Reader
from degense.app.research.reliability.tally import Tally
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent

SECONDS, MEBIBYTES = 10.0, 1024
LINKED = 1 << 20  # bytes from which a file is linked instead of copied
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
    whole, at, where, rng = scratch / "whole", scratch / "at", scratch / "where", random.Random(f"{seed} {reader.name}")
    at.mkdir(parents=True)
    # Not here: a process that has drawn or computed with several threads cannot be forked.
    made = guarded(lambda: where.write_text(str(reader.make(at)), encoding="utf-8"), 600, 16 << 10)
    path = Path(where.read_text(encoding="utf-8")) if where.exists() else at
    at.rename(whole)
    files = [sorted(file for file in whole.glob(pattern) if file.is_file()) for pattern in reader.spoilt]
    found = Tally(reader.name)
    if not any(files):
        raise DegenseError(f"There is nothing to damage in the sample of {reader.name}: {made.outcome} {made.words}")
    for case in range(-1, count):
        shutil.copytree(whole, at, copy_function=_linked)
        words = "sound"
        if case >= 0:
            spoilt = rng.choice(rng.choice([some for some in files if some]))
            words = f"case {case}, {spoilt.relative_to(whole)}"
            copy, data = at / spoilt.relative_to(whole), mutated(spoilt.read_bytes(), spoilt.name, rng)
            copy.unlink()
            copy.write_bytes(data)
        fate = guarded(lambda: reader.read(path), SECONDS, MEBIBYTES)
        if case < 0 and (made.outcome, fate.outcome) != (READ, READ):
            raise DegenseError(f"The sound sample of {reader.name} cannot be read: {made.words} {fate.outcome} {fate.words}")
        if case >= 0:
            found.add(fate, words)
        shutil.rmtree(at)
        progress((case + 1) / count)
    shutil.rmtree(scratch)
    return found


def _linked(source: str, target: str) -> None:
    """Copy a file, or link a large one: nothing writes into one that is there."""
    (os.link if os.stat(source).st_size > LINKED else shutil.copyfile)(source, target)
