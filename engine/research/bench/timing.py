"""Wall time of repeated work, on the CPU or with a GPU's queue drained."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import torch


def measure(work: Callable[[], object], repeats: int, device: torch.device | str = "cpu", warm: int = 3) -> list[float]:
    """Wall times of `repeats` calls, ms, after `warm` calls that do not count. On CUDA every call ends with its queue drained."""
    drain = _drain(device)
    times = []
    for i in range(warm + repeats):
        drain()
        begin = time.perf_counter()
        work()
        drain()
        if i >= warm:
            times.append((time.perf_counter() - begin) * 1e3)
    return times


def measure_in_turn(
    works: Sequence[Callable[[], object]], repeats: int, device: torch.device | str = "cpu", warm: int = 3
) -> list[list[float]]:
    """As `measure` for several works, one call of each in turn: a machine that is busy for a while slows them alike."""
    times: list[list[float]] = [[] for _ in works]
    for i in range(warm + repeats):
        for work, of_work in zip(works, times, strict=True):
            [taken] = measure(work, 1, device, warm=0)
            if i >= warm:
                of_work.append(taken)
    return times


def throughput(work: Callable[[int], object], count: int, device: torch.device | str = "cpu", warm: int = 3) -> float:
    """Calls a second when `work(i)` is called `count` times back to back and the queue is drained once, at the end: a player's rate."""
    drain = _drain(device)
    for i in range(warm):
        work(i)
    drain()
    begin = time.perf_counter()
    for i in range(count):
        work(i)
    drain()
    return count / (time.perf_counter() - begin)


def percentile(times: Sequence[float], share: float) -> float:
    """The time under which `share` per cent of `times` lie."""
    return float(np.percentile(times, share))


def thread_counts(cores: int) -> list[int]:
    """1, 2, 4, … and all cores."""
    counts = [1]
    while counts[-1] * 2 < cores:
        counts.append(counts[-1] * 2)
    return counts + [cores] * (cores > 1)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """A block in which torch and our kernels use `count` threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _drain(device: torch.device | str) -> Callable[[], None]:
    return torch.cuda.synchronize if torch.device(device).type == "cuda" else lambda: None
