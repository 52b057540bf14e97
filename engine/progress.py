"""How long work reports and stops: one callable, passed down."""

from collections.abc import Callable, Generator
from typing import TypeVar

Result = TypeVar("Result")

#: `progress(fraction in [0, 1], what is being done now)`. It may raise `engine.errors.Cancelled`; the work then stops and cleans up.
Progress = Callable[[float, str], None]

#: Long work as a generator: it yields (fraction in [0, 1], what is being done), returns its result, and stops where it is closed.
Steps = Generator[tuple[float, str], None, Result]


def silent(fraction: float, message: str) -> None:
    """A `Progress` that ignores what it is told."""


def finish(steps: Steps[Result], progress: Progress = silent) -> Result:
    """Do all the steps at one go; their result."""
    try:
        while True:
            progress(*next(steps))
    except StopIteration as stop:
        return stop.value
    finally:
        steps.close()
