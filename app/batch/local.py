"""A batch in processes of this machine: so many jobs at a time, each with its share of the cores and its GPU."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait

from degense.app.batch.child import order, start
from degense.app.batch.folder import BatchFolder
from degense.app.batch.plan import BatchJob
from degense.app.batch.progress import BatchProgress
from degense.engine.gpu import gpu_usable
from degense.engine.processes.capacity import slot_environment, trainings_at_once
from degense.engine.processes.job_process import JobProcess, ProcessGone

ATTEMPTS = 2  # of a job whose process ended without an answer: the second goes on where the first was


def device_of(jobs: Sequence[BatchJob]) -> str:
    """ "cuda" where a job may use a GPU and there is one, else "cpu"."""
    if all(job.training.device == "cpu" for job in jobs):
        return "cpu"
    return "cuda" if gpu_usable() else "cpu"


def slots_for(jobs: Sequence[BatchJob], device: str) -> int:
    """As many as the machine holds, and no more than there are jobs: the cores are shared out among the slots."""
    return max(1, min(len(jobs), trainings_at_once(device)))


def run_here(
    folder: BatchFolder, jobs: Sequence[BatchJob], slots: int, device: str, progress: BatchProgress, stop: Callable[[], bool]
) -> None:
    """Do the jobs; returns when all have ended, or `stop()` turned true and those that ran have saved what they had.

    A KeyboardInterrupt ends them at once.
    """
    waiting = deque(jobs)
    found = [_Slot(folder, number, slots, device, progress, stop) for number in range(slots)]
    with ThreadPoolExecutor(slots, thread_name_prefix="slot") as threads:
        futures = [threads.submit(slot, waiting) for slot in found]
        try:
            while wait(futures, timeout=1.0).not_done:
                pass
        except KeyboardInterrupt:
            waiting.clear()
            for slot in found:
                slot.kill()
            raise
    for future in futures:
        future.result()


class _Slot:
    """One process after the other, for one job after the other."""

    def __init__(
        self, folder: BatchFolder, number: int, slots: int, device: str, progress: BatchProgress, stop: Callable[[], bool]
    ) -> None:
        self._folder, self._progress, self._stop = folder, progress, stop
        self._environment = slot_environment(number, slots, device)
        self._process: JobProcess | None = None

    def __call__(self, waiting: deque[BatchJob]) -> None:
        try:
            while not self._stop():
                try:
                    job = waiting.popleft()
                except IndexError:
                    return
                self._do(job)
        finally:
            if self._process is not None:
                self._process.close()

    def kill(self) -> None:
        """End the process at once."""
        if self._process is not None:
            self._process.kill()

    def _do(self, job: BatchJob) -> None:
        name, progress = job.name, self._progress
        progress.tell(name, "", 0.0, "starting")
        for attempt in range(ATTEMPTS):
            self._process = self._process or start(self._environment)
            try:
                answer = self._process.do(
                    order(self._folder, job), lambda said: progress.tell(name, said["stage"], said["fraction"], said["words"]), self._stop
                )
            except ProcessGone as error:
                self._process = None
                if self._stop():
                    return progress.ended(name, "stopped")
                if attempt + 1 < ATTEMPTS:
                    progress.again(name, f"{error}; it goes on in another")
                    continue
                return progress.ended(name, "failed", f"{error}, twice; fewer --slots leave each more memory.")
            return progress.ended(name, answer["outcome"], answer["words"])
