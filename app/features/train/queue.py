"""Which training runs, which is paused, and which wait for their turn. No Qt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from degense.app.features.train.job import TrainingJob
from degense.app.session.state import Signal
from degense.engine.errors import DegenseError


class TrainingQueue:
    """One training at a time; the others wait in order. While one is paused, none of them starts: somebody wants the machine.

    What is not done when the program ends is kept (`jobs`), and comes back paused (`restore`).

    Signals
    -------
    changed()
    """

    def __init__(self) -> None:
        self.changed: Signal[[]] = Signal()
        self.running: TrainingJob | None = None
        self.paused: TrainingJob | None = None
        self._waiting: list[TrainingJob] = []

    @property
    def waiting(self) -> tuple[TrainingJob, ...]:
        return tuple(self._waiting)

    @property
    def jobs(self) -> tuple[TrainingJob, ...]:
        """All that is not done: what runs or is paused, then what waits."""
        return tuple(job for job in (self.running, self.paused, *self._waiting) if job is not None)

    def restore(self, jobs: Sequence[TrainingJob]) -> None:
        """Take over what an earlier start of the program left; nothing of it starts before `resume`."""
        self.paused, self._waiting = (jobs[0] if jobs else None), list(jobs[1:])
        self.changed.emit()

    def add(self, job: TrainingJob) -> None:
        """Let a training wait for its turn. DegenseError when another one here writes into the same folder."""
        if any(other.out.resolve() == job.out.resolve() for other in self.jobs):
            raise DegenseError(f"A training into {job.out} is in the queue already; choose another folder.")
        self._waiting.append(job)
        self.changed.emit()

    def remove(self, index: int) -> None:
        del self._waiting[index]
        self.changed.emit()

    def raise_(self, index: int) -> None:
        """Let a waiting training come one place earlier; the first stays."""
        if index > 0:
            self._waiting[index - 1 : index + 1] = self._waiting[index], self._waiting[index - 1]
            self.changed.emit()

    def next(self) -> TrainingJob | None:
        """Whose turn it is now; it counts as running from here on. None when nothing waits or something runs or is paused."""
        if self.running or self.paused or not self._waiting:
            return None
        self.running = self._waiting.pop(0)
        self.changed.emit()
        return self.running

    def ended(self, *, paused: bool = False) -> None:
        """The running training is over, or has made room to go on later."""
        job, self.running = self.running, None
        self.paused = job if paused else None
        self.changed.emit()

    def resume(self) -> None:
        """Put the paused training at the head of the queue: from its checkpoint, or from the start when it had not come to one."""
        if self.paused is not None:
            job, self.paused = self.paused, None
            self._waiting.insert(0, replace(job, resume=(job.out / "run.json").is_file()))
            self.changed.emit()

    def forget_paused(self) -> None:
        """Give the paused training up; its folder keeps the checkpoint. The next takes its place: the machine is still wanted."""
        self.paused = self._waiting.pop(0) if self._waiting else None
        self.changed.emit()
