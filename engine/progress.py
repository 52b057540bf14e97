"""How long work reports and stops: one callable, passed down; and how reading stops, which opens files in many places."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from typing import TypeVar

from degense.engine.errors import Cancelled

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


_reading = threading.local()


@contextmanager
def stoppable_reading(stop: Callable[[], bool]) -> Iterator[None]:
    """Meanwhile, in this thread, the next file that is opened raises `Cancelled` when `stop()` says so."""
    _reading.stop = stop
    try:
        yield
    finally:
        del _reading.stop


def check_reading() -> None:
    """Called before a file from elsewhere is opened. Cancelled within `stoppable_reading`."""
    stop = getattr(_reading, "stop", None)
    if stop is not None and stop():
        raise Cancelled
