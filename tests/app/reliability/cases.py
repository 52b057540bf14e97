"""Cases of the campaign by their names, for a process of their own.

The campaign forks. A test worker that has drawn windows or computed in several threads must not: its locks would be held for ever in the
fork, or its graphics driver crash there.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from degense.app.research.reliability import faults, kills
from degense.app.research.reliability.guarded import Fate, guarded
from degense.app.research.reliability.kills import exports, trainings
from degense.app.research.reliability.kills.program import Program
from degense.app.research.reliability.kills.programs import programs
from degense.app.research.reliability.kills.whole import Expected, check_whole
from degense.app.research.reliability.samples import FRAMES, SHAPE
from degense.app.research.reliability.tally import Tally
from degense.engine.scene import Scene


def named(name: str) -> Program:
    return next(program for program in programs() if program.name == name)


def met(name: str, scratch: Path) -> Fate:
    """What becomes of the fault whose name begins so."""
    return faults.meet(next(fault for fault in faults.faults() if fault.name.startswith(name)), scratch)


def halved(scratch: Path) -> dict[str, tuple[Fate, Fate]]:
    """What becomes of an export of each format when it is read, and when its end is missing."""
    trainings.small_run(scratch)
    scene, found, expected = Scene.open(scratch / "run", device="cpu"), {}, Expected(SHAPE, FRAMES, exports.FRAMES)
    for name in exports.EXPORTS:
        path = scratch / f"{name}{exports.suffix(name)}"
        exports.export(scene, name, path)
        whole = guarded(partial(check_whole, name, path, expected), 20.0, 4096)
        file = path if path.is_file() else max(path.rglob("*.*"), key=lambda file: file.stat().st_size)
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        found[name] = whole, guarded(partial(check_whole, name, path, expected), 20.0, 4096)
    return found


def killed(name: str, how: str, count: int, scratch: Path, longest: float) -> Tally:
    """A program killed so often."""
    return kills.tally(named(name), how, count, scratch, seed=2, longest=longest)
