"""Many trainings at once: each in a process of its own with one thread, so that they neither wait for each other nor share a state."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from typing import Any, TypeVar

from degense.engine.processes.capacity import thread_environment
from degense.engine.processes.parent import end_with_parent
from degense.engine.progress import Progress

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")


def run_jobs(
    work: Callable[[Job], Outcome], jobs: Sequence[Job], workers: int, progress: Progress, words: str
) -> Iterator[tuple[int, Outcome]]:
    """`work(job)` of every job, as they finish: (number of the job, what it returned).

    `work` and the jobs must be importable and picklable. The first exception of a worker is raised here, and the others are left out.
    """
    context: Any = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(jobs)) or 1, mp_context=context, initializer=_one_thread)
    try:
        pending = {pool.submit(work, job): number for number, job in enumerate(jobs)}
        progress(0.0, f"{words}: {len(jobs)} on {min(workers, len(jobs))} processes")
        while pending:
            done, _ = wait(pending, timeout=1.0, return_when=FIRST_COMPLETED)
            for future in done:
                yield pending.pop(future), future.result()
            finished = len(jobs) - len(pending)
            progress(finished / len(jobs), f"{words}: {finished} of {len(jobs)}")
    finally:
        pool.shutdown(cancel_futures=True)


def _one_thread() -> None:
    """Before any numeric library is imported in this process, which does not outlive the one that started it."""
    end_with_parent()
    os.environ.update(thread_environment(1))
    import cv2
    import torch

    cv2.setNumThreads(1)
    torch.set_num_threads(1)
