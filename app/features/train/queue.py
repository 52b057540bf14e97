"""The trainings of a window: which run, which wait for their turn, and which were paused. No Qt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from degense.app.features.train.job import TrainingJob
from degense.app.session.state import Signal
from degense.engine.errors import DegenseError


class TrainingQueue:
    """So many trainings at a time as `slots()` says; the others wait in order. While any is paused, none starts: the machine is wanted.

    What is not done when the program ends is kept (`jobs`), and comes back with its first training paused (`restore`).
    """

    def __init__(self, slots: Callable[[], int] = lambda: 1) -> None:
        self.changed: Signal[[]] = Signal()
        self._slots = slots
        self._running: list[TrainingJob] = []
        self._paused: list[TrainingJob] = []
        self._waiting: list[TrainingJob] = []

    @property
    def running(self) -> tuple[TrainingJob, ...]:
        return tuple(self._running)

    @property
    def paused(self) -> TrainingJob | None:
        """The first of those that were paused."""
        return self._paused[0] if self._paused else None

    @property
    def waiting(self) -> tuple[TrainingJob, ...]:
        return tuple(self._waiting)

    @property
    def jobs(self) -> tuple[TrainingJob, ...]:
        """All that is not done: what runs, what is paused, then what waits."""
        return (*self._running, *self._paused, *self._waiting)

    @property
    def full(self) -> bool:
        """Whether a training that is added now waits."""
        return bool(self._paused) or len(self._running) + len(self._waiting) >= self._slots()

    def restore(self, jobs: Sequence[TrainingJob]) -> None:
        """Take over what an earlier start of the program left; nothing of it starts before `resume`."""
        self._paused, self._waiting = list(jobs[:1]), list(jobs[1:])
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
        """Whose turn it is now; it counts as running from here on. None when nothing waits, as many run as may, or any is paused."""
        if self._paused or not self._waiting or len(self._running) >= self._slots():
            return None
        self._running.append(self._waiting.pop(0))
        self.changed.emit()
        return self._running[-1]

    def ended(self, job: TrainingJob, *, paused: bool = False) -> None:
        """A running training is over, or has made room to go on later."""
        self._running.remove(job)
        self._paused += [job] * paused
        self.changed.emit()

    def resume(self) -> None:
        """Put what is paused at the head of the queue: from its checkpoint, or from the start when it had not come to one."""
        if self._paused:
            self._waiting[:0] = [replace(job, resume=(job.out / "run.json").is_file()) for job in self._paused]
            self._paused = []
            self.changed.emit()

    def forget_paused(self) -> None:
        """Give the first paused training up; its folder keeps the checkpoint. Of what waits, the next is paused when no other is."""
        del self._paused[:1]
        if not self._paused:
            self._paused, self._waiting = self._waiting[:1], self._waiting[1:]
        self.changed.emit()
