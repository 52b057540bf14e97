"""How far a batch is: the state of every job, and what programs and people are told of it."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from degense.app.batch.plan import BatchJob

#: "stopped": it was begun and can be gone on with.
State = Literal["waiting", "running", "done", "failed", "stopped"]


@dataclass
class JobProgress:
    """A job as it is known here; `seconds` are those of this call."""

    name: str
    state: State = "waiting"
    stage: str = ""
    fraction: float = 0.0  # of the stage
    words: str = ""  # what is being done, or why it failed
    seconds: float = 0.0
    begun: float = field(default=0.0, repr=False)

    def to_json(self) -> dict[str, Any]:
        """The event of `--json`."""
        values = {"state": self.state, "stage": self.stage, "fraction": round(self.fraction, 4), "words": self.words}
        return {"event": "job", "job": self.name, **values, "seconds": round(self.seconds, 2)}


class BatchProgress:
    """All jobs of a batch. Slots and workers tell it what happens, from any thread; `changed` hears of each change."""

    def __init__(self, jobs: Sequence[BatchJob], finished: Sequence[BatchJob], changed: Callable[[JobProgress], None]) -> None:
        there = {job.name for job in finished}
        self.jobs = {job.name: JobProgress(job.name, "done" if job.name in there else "waiting") for job in jobs}
        self._changed, self._lock = changed, threading.RLock()

    def tell(self, name: str, stage: str, fraction: float, words: str) -> None:
        """A job runs and has come so far."""
        with self._lock:
            job = self.jobs[name]
            if job.state in ("done", "failed", "stopped"):
                return  # news that a cluster brought after the end
            job.begun, job.state = job.begun or time.monotonic(), "running"
            job.stage, job.fraction, job.words = stage, fraction, words
            job.seconds = time.monotonic() - job.begun
            self._changed(job)

    def ended(self, name: str, outcome: State, words: str = "") -> None:
        """A job is done, has failed, or was stopped."""
        with self._lock:
            job = self.jobs[name]
            job.seconds = time.monotonic() - job.begun if job.begun else 0.0
            job.state, job.words = outcome, words
            self._changed(job)

    def again(self, name: str, words: str) -> None:
        """What did a job is lost; it goes on elsewhere."""
        with self._lock:
            job = self.jobs[name]
            job.state, job.words = "waiting", words
            self._changed(job)

    def count(self) -> Counter[State]:
        with self._lock:
            return Counter(job.state for job in self.jobs.values())
