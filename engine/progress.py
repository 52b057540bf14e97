"""How long work reports and stops: one callable, passed down."""

from collections.abc import Callable

#: `progress(fraction in [0, 1], what is being done now)`. It may raise `engine.errors.Cancelled`; the work then stops and cleans up.
Progress = Callable[[float, str], None]


def silent(fraction: float, message: str) -> None:
    """A `Progress` that ignores what it is told."""
