"""One worker thread for everything that takes longer than a blink: drawing, curves, ranges, opening, exporting."""

from __future__ import annotations

import inspect
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QObject, Signal

from degense.engine.errors import OUT_OF_MEMORY, Cancelled, DegenseError, is_out_of_memory

log = logging.getLogger(__name__)

Job = Callable[[], Any]


@dataclass(eq=False)
class _Task:
    """A job and who listens to it; `steps` is the generator that it returned."""

    job: Job
    done: Callable[[Any], None]
    failed: Callable[[str], None]
    progress: Callable[[Any], None] | None
    steps: Any = None


class Worker(QObject):
    """Runs jobs in one thread, the latest of each channel only, and hands their results to the thread that asked.

    A job is a function without arguments. If it returns a generator, the generator is run step by step: what it yields goes to `progress`,
    and between two steps the worker turns to more urgent channels; a newer job on the same channel closes it there. Results of replaced or
    cancelled jobs are dropped, so what arrives always answers the last question. A DegenseError arrives at `failed` in its own words; any
    other exception is logged with its traceback and arrives as a short sentence.
    """

    freed = Signal(str)  # (channel) the answer of a channel's last job has been delivered
    _reported = Signal(str, object, str, object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._urgencies: dict[str, int] = {}
        self._awaited: dict[str, _Task] = {}
        self._wake = threading.Condition()
        self._tasks: dict[str, _Task | None] = {}  # the most urgent channel first
        self._replaced: list[_Task] = []
        self._stopping = False
        #: Called in the worker's thread after each step of a job.
        self.after_step: Callable[[], object] = lambda: None
        self._reported.connect(self._deliver)
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._thread.start()

    def add_channel(self, name: str, urgency: int) -> None:
        """Let jobs be submitted on a channel; of several that wait the one with the lowest number runs first.

        Numbers in use: opening 0, checking a clip 10, drawing 20, what is read off a view 30, giving memory back 35, a second run 40,
        curves and findings 50, annotating 60, exporting 70, the whole clip 80, diagnostics 90.
        """
        self._urgencies[name] = urgency
        with self._wake:
            self._tasks = {channel: self._tasks.get(channel) for channel in sorted(self._urgencies, key=self._urgencies.__getitem__)}

    def submit(
        self,
        channel: str,
        job: Job,
        done: Callable[[Any], None],
        failed: Callable[[str], None],
        progress: Callable[[Any], None] | None = None,
    ) -> None:
        """Run `job` as soon as nothing more urgent waits; it replaces what is waiting or running on its channel."""
        self._awaited[channel] = _Task(job, done, failed, progress)
        self._put(channel, self._awaited[channel])

    def cancel(self, channel: str) -> None:
        """Forget the job of a channel: it stops at its next step and its result is dropped."""
        self._awaited.pop(channel, None)
        self._put(channel, None)

    def busy(self, channel: str) -> bool:
        """Whether an answer is still to come on a channel."""
        return channel in self._awaited

    def idle(self, *but: str) -> bool:
        """Whether no answer is to come on any channel, of some channels apart."""
        return not set(self._awaited).difference(but)

    def close(self) -> None:
        """Stop the worker after its present step; nothing is delivered afterwards."""
        self._awaited.clear()
        with self._wake:
            self._stopping = True
            self._wake.notify()
        self._thread.join()

    def _deliver(self, channel: str, task: _Task, kind: str, payload: object) -> None:
        if self._awaited.get(channel) is not task:
            return
        if kind == "progress":
            if task.progress is not None:
                task.progress(payload)
            return
        del self._awaited[channel]
        if kind != "cancelled":
            getattr(task, kind)(payload)
        self.freed.emit(channel)

    def _put(self, channel: str, task: _Task | None) -> None:
        with self._wake:
            old = self._tasks[channel]
            if old is not None:
                self._replaced.append(old)
            self._tasks[channel] = task
            self._wake.notify()

    # In the worker's thread

    def _run(self) -> None:
        while (step := self._next()) is not None:
            self._step(*step)
            self.after_step()

    def _next(self) -> tuple[str, _Task] | None:
        """The most urgent task, waiting for one; None to end. Replaced generators are closed here, in the thread that runs them."""
        with self._wake:
            while True:
                replaced, self._replaced = self._replaced, []
                for old in [*replaced, *self._tasks.values()] if self._stopping else replaced:
                    if old is not None and old.steps is not None:
                        old.steps.close()
                if self._stopping:
                    return None
                for channel, task in self._tasks.items():
                    if task is not None:
                        return channel, task
                self._wake.wait()

    def _step(self, channel: str, task: _Task) -> None:
        try:
            if task.steps is None:
                result = task.job()
                if not inspect.isgenerator(result):
                    self._finish(channel, task, "done", result)
                    return
                task.steps = result
            self._reported.emit(channel, task, "progress", next(task.steps))
        except StopIteration as stop:
            self._finish(channel, task, "done", stop.value)
        except Cancelled:
            self._finish(channel, task, "cancelled", None)
        except DegenseError as error:
            self._finish(channel, task, "failed", str(error))
        except Exception as error:
            log.exception("a job on channel %s failed", channel)
            mistake = f"The program made a mistake ({type(error).__name__}: {error}); the log has the details."
            self._finish(channel, task, "failed", OUT_OF_MEMORY if is_out_of_memory(error) else mistake)

    def _finish(self, channel: str, task: _Task, kind: str, payload: object) -> None:
        with self._wake:
            if self._tasks[channel] is task:
                self._tasks[channel] = None
        self._reported.emit(channel, task, kind, payload)
