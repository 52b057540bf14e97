"""Peak memory of a piece of work, which takes a process of its own to measure."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeVar

Value = TypeVar("Value")


def in_child(work: Callable[..., Value], *arguments: object) -> Value:
    """`work(*arguments)` in a fresh process. Its exceptions are raised here.

    `work` must be a module's function, its arguments and its value plain enough to be sent.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=context) as pool:
        return pool.submit(work, *arguments).result()


def peak_memory() -> float | None:
    """The most memory this process ever held, MB, interpreter and libraries included; None where the system does not tell (not Linux).

    The kernel's high-water mark of this program alone. `ru_maxrss` would not do: it begins at that of the process that started it.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except FileNotFoundError:
        return None
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM:"))
