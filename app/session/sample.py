"""The embedded sample: a synthetic clip and its finished run, small enough to travel with the program."""

from __future__ import annotations

from pathlib import Path

from degense.engine.errors import DegenseError

ASSETS = Path(__file__).resolve().parents[2] / "assets"
SAMPLE = "demo"


def demo_run() -> Path:
    """The run folder of the sample. DegenseError when this installation does not hold it."""
    run = ASSETS / SAMPLE / "run"
    if not (run / "run.json").is_file():
        raise DegenseError(
            f"The sample is missing from this installation ({run}); install the program again, or make a clip with degense phantom."
        )
    return run


def is_demo(path: Path) -> bool:
    """Whether a path lies in the sample, which the program never changes."""
    return path.resolve().is_relative_to(ASSETS / SAMPLE)
