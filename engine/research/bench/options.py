"""How a benchmark is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class BenchOptions:
    """What every benchmark is told.

    Attributes
    ----------
    device : {"cpu", "cuda"}
    seeds : tuple of int
        Of trainings and random scenes; figures over seeds are stated with their spread.
    repeats : int
        Of each timing.
    quick : bool
        Smaller scenes and shorter trainings: to see that it runs, not to quote.
    scratch : Path
        A folder for clips and runs made on the way; its owner deletes it.
    clips : tuple of Path
        Real clips to measure on beside the phantoms.
    """

    device: str
    seeds: tuple[int, ...]
    repeats: int
    quick: bool
    scratch: Path
    clips: tuple[Path, ...] = ()
