"""What a program that is killed consists of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

#: How a program ends: by a signal, or because the power fails.
ENDS = ("SIGKILL", "SIGTERM", "power cut")


@dataclass(frozen=True)
class Killed:
    """What a check is told: when it ended (seconds of the monotonic clock), and whether the power failed."""

    moment: float
    power: bool


@dataclass(frozen=True)
class Program:
    """`prepare(folder)` makes what it needs, once; `work(folder)` writes into `folder / "out"`; `check(folder, killed)` raises for what is
    lost, AssertionError in words or whatever a reader says."""

    name: str
    prepare: Callable[[Path], None]
    work: Callable[[Path], None]
    check: Callable[[Path, Killed], None]
    begun: Callable[[Path], bool]  # whether there is anything yet of what the check is about
    ends: tuple[str, ...] = ENDS
    by_system_calls: bool = False  # whether a power cut is modelled by all its calls, not only by what Python syncs
    weight: float = 1.0  # of its rows in the number of kills
    patience: float = 60.0  # seconds that the check may take
