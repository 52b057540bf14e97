"""How many trainings a machine holds at a time, and what each of them may use of it."""

from __future__ import annotations

import os
from pathlib import Path

GPU_BYTES = 4 << 30  # of memory that a training may take on a GPU, its context included
RAM_BYTES = 3 << 29  # of memory that a training may take beside the processor
MOST = 12  # more trainings than this only wait for a GPU
#: Where numeric libraries read, when they are imported, how many threads they may use.
NUMERIC = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def free_ram() -> int | None:
    """Bytes of memory that programs can still have; None where the system does not tell (not Linux)."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) << 10 for line in lines if line.startswith("MemAvailable:")), None)


def trainings_at_once(device: str) -> int:
    """How many trainings fit beside each other: as many as there are cores and memory for, and on GPUs as their free memory holds.

    `device` is "cpu" or "cuda".
    """
    fits = cores()
    if (free := free_ram()) is not None:
        fits = min(fits, free // RAM_BYTES)
    if device == "cuda":
        import torch

        held = (torch.cuda.mem_get_info(index)[0] // GPU_BYTES for index in range(torch.cuda.device_count()))
        fits = min(fits, sum(min(MOST, number) for number in held))
    return max(1, fits)


def gpus() -> list[str]:
    """The names by which `CUDA_VISIBLE_DEVICES` calls the GPUs that this process sees."""
    named = [name for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name]
    if named:
        return named
    import torch

    return [str(index) for index in range(torch.cuda.device_count())]


def slot_environment(number: int, slots: int, device: str) -> dict[str, str]:
    """Variables for the process of slot `number` of `slots`: its share of the cores, and on CUDA its GPU, in turn."""
    values = thread_environment(max(1, cores() // slots))
    if device == "cuda" and (visible := gpus()):
        values["CUDA_VISIBLE_DEVICES"] = visible[number % len(visible)]
    return values


def thread_environment(threads: int) -> dict[str, str]:
    """Variables that give a process so many threads for numeric work."""
    return dict.fromkeys(NUMERIC, str(threads))
