"""Runs a sweep: clips are drawn and baselines scored beside the trainings, of which so many go on at a time. It resumes."""

from __future__ import annotations

import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from degense.engine.files import write_text
from degense.engine.processes.capacity import NUMERIC, cores, slot_environment, thread_environment
from degense.engine.progress import Progress
from degense.engine.research.bench.table import Table
from degense.engine.research.sweep.schedule import Job, Schedule
from degense.engine.research.sweep.work import begin_process, warm_up
from degense.engine.store.files import write_json

_ENVIRONMENT = threading.Lock()


@dataclass(frozen=True)
class Work:
    """What a sweep does: functions of its schedule, and of a scene or a job. `prepare` and those that score run in other processes."""

    prepare: Callable[[Any, Any], None]  # of a scene: what its trainings share
    baseline_files: Callable[[Any, Any], Iterable[Path]]  # of a scene: where the scores of its baselines are kept
    score_baselines: Callable[[Any, Any], None]  # of a scene: writes those files that are missing
    score_job: Callable[[Any, Any], dict[str, Any]]  # of a job: trains it; its scores
    tables_of: Callable[[Any], list[Table]]  # of what is there


def sweep(plan: Schedule, work: Work, progress: Progress) -> Iterator[Table]:
    """Train what is missing in the folder of the sweep, and make the tables of what is there."""
    plan.begin()
    if not plan.tables_only:
        train_all(plan, work, progress)
    yield from work.tables_of(plan)


def train_all(plan: Schedule, work: Work, progress: Progress) -> None:
    """Train and score what is missing, until all is done or the time limit is reached."""
    started = time.monotonic()
    for folder in ("clips", "scores", "flow"):
        (plan.out / folder).mkdir(parents=True, exist_ok=True)
    with _pool(plan, cores(), thread_environment(1)) as helpers:
        missing = {job.scene for job in plan.jobs if not plan.scores(job).exists()}
        late = [scene for scene in plan.scenes if plan.baselines and not all(path.exists() for path in work.baseline_files(plan, scene))]
        scenes = {scene: helpers.submit(work.prepare, plan, scene) for scene in plan.scenes if scene in missing.union(late)}
        queue = _Queue(plan, scenes, started)
        with ThreadPoolExecutor(plan.slots + len(late)) as threads:
            _after_warm_up(plan, bool(queue.waiting))
            slots = [threads.submit(_slot, plan, work, number, queue) for number in range(plan.slots)]
            baselines = {scene: threads.submit(_baselines, plan, work, scene, scenes[scene], helpers) for scene in late}
            while wait([*slots, *baselines.values()], timeout=1.0).not_done:
                progress(queue.share, queue.words)
                if queue.over:
                    helpers.shutdown(wait=False, cancel_futures=True)
        for what, futures in (("clip", scenes), ("baselines", baselines)):
            for scene, future in futures.items():
                if not future.cancelled() and (error := future.exception()) and not isinstance(error, CancelledError):
                    _say(f"the {what} of scene {scene} failed: {error}")


class _Queue:
    """The jobs that are to be done, handed out to the slots."""

    def __init__(self, plan: Schedule, scenes: dict[Any, Future[None]], started: float):
        self._plan, self._scenes, self._started, self._lock = plan, scenes, started, threading.Lock()
        self.waiting = [job for job in plan.jobs if not plan.scores(job).exists()]
        self.total, self.done, self.failed = len(self.waiting), 0, 0

    @property
    def over(self) -> bool:
        """Whether nothing new is to be begun."""
        return time.monotonic() - self._started > self._plan.time_limit

    @property
    def share(self) -> float:
        return (self.done + self.failed) / max(1, self.total)

    @property
    def words(self) -> str:
        return f"{self.done} of {self.total} trained" + f", {self.failed} failed" * bool(self.failed)

    def take(self) -> Job | None:
        """The next job, one whose clip is drawn if there is any; None when there is none, or the time is over."""
        with self._lock:
            if self.over or not self.waiting:
                return None
            ready = (job for job in self.waiting if self._scenes[job.scene].done())
            job = next(ready, self.waiting[0])
            self.waiting.remove(job)
        wait([self._scenes[job.scene]])  # a clip that could not be drawn fails the training
        return None if self.over else job

    def finished(self, job: Job, error: str | None, seconds: float) -> None:
        """Count a job and say so."""
        with self._lock:
            self.failed, self.done = self.failed + bool(error), self.done + (not error)
            _say(f"{self.words} after {time.monotonic() - self._started:.0f} s: {job.name} {'FAILED' if error else f'{seconds:.0f} s'}")


def _slot(plan: Schedule, work: Work, number: int, queue: _Queue) -> None:
    """Do jobs in a process of its own, which is replaced when one kills it. A failed job writes its error; the others go on."""
    pool: ProcessPoolExecutor | None = None
    while (job := queue.take()) is not None:
        begun, error = time.monotonic(), None
        pool = pool or _slot_pool(plan, number)
        complaint = plan.scores(job).with_suffix(".error.txt")
        try:
            write_json(plan.scores(job), pool.submit(work.score_job, plan, job).result())
            complaint.unlink(missing_ok=True)
        except BrokenProcessPool:
            error, pool = "its process ended without a result", None
        except Exception:
            error = traceback.format_exc()
        if error:
            write_text(complaint, error)
        queue.finished(job, error, time.monotonic() - begun)
    if pool is not None:
        pool.shutdown()


def _baselines(plan: Schedule, work: Work, scene: Any, drawn: Future[None], helpers: ProcessPoolExecutor) -> None:
    """Score the baselines of a scene as soon as it is drawn."""
    drawn.result()
    helpers.submit(work.score_baselines, plan, scene).result()


def _after_warm_up(plan: Schedule, needed: bool) -> None:
    """On a GPU, compile kernels once before several processes would."""
    if needed and plan.device == "cuda":
        with _slot_pool(plan, 0) as pool:
            pool.submit(warm_up, plan).result()


def _slot_pool(plan: Schedule, number: int) -> ProcessPoolExecutor:
    """The process of a slot, on its GPU."""
    with _ENVIRONMENT:  # it names the GPU of another slot while that begins
        environment = slot_environment(number, plan.slots, plan.device)
    return _pool(plan, 1, environment)


def _pool(plan: Schedule, workers: int, environment: Mapping[str, str]) -> ProcessPoolExecutor:
    """Processes with this environment: their numeric libraries read it when they are imported."""
    threads = int(environment[NUMERIC[0]])
    pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=begin_process, initargs=(threads, plan.out / "flow"))
    with _ENVIRONMENT:
        before = {name: os.environ.get(name) for name in environment}
        os.environ.update(environment)
        for _ in range(workers):
            pool.submit(int)  # starts a process
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    return pool


def _say(words: str) -> None:
    print(words, file=sys.stderr, flush=True)
