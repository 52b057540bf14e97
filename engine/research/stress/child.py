"""Work in a process of its own whose exceptions come back as they are: what is refused is an outcome here."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from degense.engine.research.bench.child import end_with_parent

Value = TypeVar("Value")


def in_child(work: Callable[..., Value], *arguments: object) -> Value:
    """`work(*arguments)` in a fresh process. Its exceptions are raised here.

    `work` must be a module's function, its arguments and its value plain enough to be sent.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=context, initializer=end_with_parent) as pool:
        return pool.submit(work, *arguments).result()
