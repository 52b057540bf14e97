"""What the command line prints while it works."""

from __future__ import annotations

import sys
import time
from typing import Any

from degense.engine.progress import Result, Steps, finish


class Bar:
    """A progress bar on one line of a terminal; silent when the stream is no terminal. It is a `Progress`."""

    def __init__(self) -> None:
        self._stream, self._shows, self._last = sys.stderr, sys.stderr.isatty(), float("-inf")

    def __call__(self, fraction: float, message: str) -> None:
        now = time.monotonic()
        if self._shows and (now - self._last >= 0.1 or fraction >= 1.0):
            self._last = now
            filled = round(24 * min(1.0, max(0.0, fraction)))
            self._stream.write(f"\r\x1b[K[{'#' * filled}{'.' * (24 - filled)}] {fraction:4.0%}  {message}"[:160])
            self._stream.flush()

    def close(self) -> None:
        """Clear the line, so that what follows starts at its beginning."""
        if self._shows and self._last > float("-inf"):
            self._stream.write("\r\x1b[K")
            self._stream.flush()


def run_steps(steps: Steps[Result], bar: Bar) -> Result:
    """Do all the steps, showing them in `bar`; their result."""
    try:
        return finish(steps, bar)
    finally:
        bar.close()


def table(values: dict[str, Any]) -> str:
    """One `name  value` line each, aligned; nested dictionaries are indented."""
    lines: list[str] = []

    def add(items: dict[str, Any], indent: str) -> None:
        width = max((len(str(key)) for key in items), default=0)
        for key, value in items.items():
            if isinstance(value, dict):
                lines.append(f"{indent}{key}")
                add(value, indent + "  ")
            else:
                shown = "–" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
                lines.append(f"{indent}{key!s:<{width}}  {shown}")

    add(values, "")
    return "\n".join(lines)
