"""Wall time of repeated work, on the CPU or with a GPU's queue drained."""

from __future__ import annotations

import time
from collections.abc import Callable

import torch


def measure(work: Callable[[], object], repeats: int, device: torch.device | str = "cpu", warm: int = 3) -> list[float]:
    """Wall times of `repeats` calls, ms, after `warm` calls that do not count. On CUDA every call ends with its queue drained."""
    drain = torch.cuda.synchronize if torch.device(device).type == "cuda" else lambda: None
    times = []
    for i in range(warm + repeats):
        drain()
        begin = time.perf_counter()
        work()
        drain()
        if i >= warm:
            times.append((time.perf_counter() - begin) * 1e3)
    return times


def throughput(work: Callable[[int], object], count: int, device: torch.device | str = "cpu", warm: int = 3) -> float:
    """Calls a second when `work(i)` is called `count` times back to back and the queue is drained once, at the end: a player's rate."""
    drain = torch.cuda.synchronize if torch.device(device).type == "cuda" else lambda: None
    for i in range(warm):
        work(i)
    drain()
    begin = time.perf_counter()
    for i in range(count):
        work(i)
    drain()
    return count / (time.perf_counter() - begin)
