"""Cases of the campaign by their names, for a process of their own.

The campaign forks. A test worker that has drawn windows or computed in several threads must not: its locks would be held for ever in the
fork, or its graphics driver crash there.
"""

from __future__ import annotations

from pathlib import Path

from degense.app.research.reliability import faults, kills, programs
from degense.app.research.reliability.guarded import Fate
from degense.app.research.reliability.tally import Tally


def named(name: str) -> programs.Program:
    return next(program for program in programs.programs() if program.name == name)


def met(name: str, scratch: Path) -> Fate:
    """What becomes of the fault whose name begins so."""
    return faults.meet(next(fault for fault in faults.faults() if fault.name.startswith(name)), scratch)


def killed(name: str, how: str, count: int, scratch: Path, longest: float) -> Tally:
    """A program killed so often."""
    return kills.tally(named(name), how, count, scratch, seed=2, longest=longest)
