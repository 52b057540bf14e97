"""Train ▸ Start, Pause and Cancel: dialog, queue, process and monitor."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from filelock import FileLock
from PySide6.QtCore import QObject
from PySide6.QtWidgets import QMessageBox

from degense.app.features.documents.controller import Documents
from degense.app.features.train.job import CLIP_OPTIONS, TrainingJob
from degense.app.features.train.monitor import TrainingMonitor
from degense.app.features.train.previews import Previews
from degense.app.features.train.process import TrainingProcess
from degense.app.features.train.queue import TrainingQueue
from degense.app.features.train.slots import environment_of, fitting
from degense.app.features.train.stage_words import stage_words
from degense.app.shell.messages import Choice
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.engine.events import Done, Event, Failed, Preview, Reliability, Rollback, Stage, Step, Stopped, TrainingProgress, read_progress

log = logging.getLogger(__name__)


class Training(QObject):
    """Trainings beside everything else, so many at a time as the settings say or the machine holds; others wait in the queue.

    The monitor shows one of those that run: `process`.
    """

    def __init__(self, shell: Shell) -> None:
        super().__init__(shell)
        self.shell, self.session, self.worker, self.documents = shell, shell.session, shell.worker, shell.service(Documents)
        self.monitor = TrainingMonitor()
        self.dock = shell.add_dock("Training", self.monitor)
        self.queue = TrainingQueue(self.slots)
        self.processes: dict[int, TrainingProcess] = {}  # by slot
        self.process: TrainingProcess | None = None
        self.previews = Previews(self.monitor, shell.worker, lambda: self.process.job if self.process is not None else None)
        self._kept: tuple[dict[str, Any], ...] = ()
        self._pausing: set[TrainingProcess] = set()
        self._stages: dict[TrainingProcess, str] = {}
        self._then: Callable[[], object] | None = None
        monitor = self.monitor
        monitor.cancel_requested.connect(self.cancel)
        monitor.pause_requested.connect(self.pause)
        monitor.resume_requested.connect(self.resume_paused)
        monitor.chosen.connect(lambda row: self._show(list(self.processes.values())[row]))
        monitor.queue.removed.connect(self.queue.remove)
        monitor.queue.raised.connect(self.queue.raise_)
        if self.documents is not None:
            self.documents.facts.train_requested.connect(self.ask)
        shell.may_close.append(self.may_close)
        shell.started.connect(self.dock.hide)  # also where the panel was open last time
        shell.started.connect(self.offer_kept)
        shell.closed.connect(lambda: self._first.release())
        self.queue.changed.connect(self._show_queue)

    @property
    def running(self) -> bool:
        return any(process.running for process in self.processes.values())

    def slots(self) -> int:
        """Trainings at once."""
        return int(self.shell.settings.value.trainings_at_once) or fitting()

    def ask(self, labels: Path | None = None) -> None:
        """Show the dialog, and start or queue what it says; a folder of label maps becomes the teacher."""
        clip, answers = self.session.clip, self.documents.clip_options if self.documents is not None else {}
        if clip is None:
            return
        if labels is not None:
            from degense.engine.data.readers import with_labels

            clip, answers = with_labels(clip, labels), {**answers, "labels": str(labels)}
        settings = self.shell.settings
        busy = self.queue.full
        from degense.app.features.train.train_dialog import TrainDialog

        dialog = TrainDialog(clip, answers, settings.value.training, busy, self.shell)

        def start() -> None:
            job = dialog.job()
            settings.update(training=job.answers())
            self.start(job)

        dialog.accepted.connect(start)
        dialog.open()

    def ask_to_resume(self) -> None:
        """Ask for a run folder whose training was stopped, and go on with it."""
        if (folder := self.shell.ask_folder("Resume the training of a run", self.shell.settings.value.last_folder)) is not None:
            self.resume(folder)

    def resume(self, run: Path) -> None:
        from degense.engine.store import Run

        def start() -> None:
            clip = Run.open(run).info["clip"]
            given = clip.get("options") or {}
            options = {name: given[name] for name in CLIP_OPTIONS if name in given}
            self.start(TrainingJob(clip=(run / str(clip["path"])).resolve(), out=run, resume=True, **options))

        self.shell.attempt(start)

    def start(self, job: TrainingJob) -> None:
        """Train as soon as it is this job's turn."""

        def add() -> None:
            waits = self.queue.full
            self.queue.add(job)
            if waits:
                self.shell.say(f"{job.out.name} waits for its turn.")
            self._next()

        self.shell.attempt(add)

    def pause(self) -> None:
        """Let all trainings save, and leave the machine to others until `resume_paused`."""
        for process in self.processes.values():
            if process.running:
                self._pausing.add(process)
                process.stop()

    def resume_paused(self) -> None:
        self.queue.resume()
        self._next()

    def cancel(self) -> None:
        """Ask the one that is shown to save and stop; one that is paused has done so, and makes room for the next to be paused."""
        if self.process is not None:
            self._pausing.discard(self.process)
            self.process.stop()
        elif self.queue.paused is not None:
            self.queue.forget_paused()
            self.monitor.cancelled("Stopped; the checkpoint can be resumed.")
            self._show_paused("Waits. Resume starts it; Cancel gives it up.")

    def offer_kept(self) -> None:
        """Show what an earlier start of the program did not finish, in the first window only. Nothing of it starts by itself."""
        jobs, settings = [], self.shell.settings
        self._first = FileLock(settings.path.with_name("trainings.lock"), timeout=0)
        try:
            settings.path.parent.mkdir(parents=True, exist_ok=True)
            self._first.acquire()
        except OSError:
            return
        self._kept = settings.value.trainings
        for data in self._kept:
            try:
                jobs.append(TrainingJob.from_json(data))
            except DegenseError as error:
                log.warning("%s", error)
                self.shell.say(str(error))
        self.queue.restore(jobs)
        self._show_paused("Left from last time. Resume goes on with it; Cancel gives it up.")

    def _show_paused(self, words: str) -> None:
        """Show the training that waits for the user, if there is one."""
        job = self.queue.paused
        if job is not None:
            self._show_monitor(job)
            self.monitor.pause(words)

    def _show_monitor(self, job: TrainingJob) -> None:
        self.shell.docks.bring(self.dock)
        self.monitor.start(f"{job.clip.name} → {job.out.name}")
        self.monitor.set_progress(*read_progress(job.out / "metrics.jsonl"))

    def _next(self) -> None:
        """Train in processes of their own those whose turn it is."""
        while (job := self.queue.next()) is not None:
            slots = self.slots()
            number = next(number for number in range(len(self.processes) + 1) if number not in self.processes)
            process = TrainingProcess(job, self, environment=environment_of(job, number, slots))
            process.told.connect(partial(self._take, process))
            process.finished.connect(partial(self._finished, process))
            process.stopped.connect(partial(self._stopped, process))
            process.failed.connect(partial(self._failed, process))
            self.processes[number] = process
            self._show(process)
            process.start()
            self.shell.refresh()

    def _show(self, process: TrainingProcess) -> None:
        """Let the monitor show this one of those that run."""
        self.process = process
        self._show_monitor(process.job)
        if stage := self._stages.get(process):
            self.monitor.set_stage(stage)
        self._name_running()

    def _name_running(self) -> None:
        running = list(self.processes.values())
        row = running.index(self.process) if self.process in running else -1
        self.monitor.set_running([process.job.out.name for process in running], row)

    def _show_queue(self) -> None:
        self.monitor.queue.set_runs([f"{job.out.name} ({job.preset})" for job in self.queue.waiting])
        before, self._kept = self._kept, tuple(job.to_json() for job in self.queue.jobs)
        own = {job.get("out") for job in (*before, *self._kept)}
        self.shell.settings.change(  # the others are those of other windows
            lambda settings: replace(settings, trainings=(*(job for job in settings.trainings if job.get("out") not in own), *self._kept))
        )
        self.shell.refresh()

    def may_close(self, close: Callable[[], object]) -> bool:
        """Whether the window may close now. If a training runs, the user is asked, and `close` is called once it has stopped."""
        if not self.running:
            return True
        waiting, several = len(self.queue.waiting), len(self.processes) > 1
        others = f", and so is the queue of {waiting}" if waiting else ""
        what = f"{len(self.processes)} trainings are running. Stop them" if several else "A training is running. Stop it"
        later = "Each saves a checkpoint; at the next start they are" if several else "It saves a checkpoint; at the next start it is"

        def stop() -> None:
            self._then = close
            self.pause()

        self.shell.ask(
            "training runs",
            f"{what} and close? {later} offered again{others}.",
            Choice("Stop and save", stop),
            Choice("Keep it running", escape=True),
            icon=QMessageBox.Icon.NoIcon,
        )
        return False

    def _take(self, process: TrainingProcess, event: Event) -> None:
        monitor = self.monitor
        if words := stage_words(event):
            self._stages[process] = words
        if process is not self.process:
            return
        match event:
            case Stage() | Step():
                monitor.set_stage(self._stages[process])
            case TrainingProgress():
                monitor.set_progress(event)
            case Preview(path, frame):
                self.previews.show(process.job, path, frame)
            case Reliability(words):
                monitor.note(words)
            case Rollback(iteration, reason):
                monitor.note(f"went back to iteration {iteration}: {reason}")
            case Done() | Stopped() | Failed():  # the process says so when it has ended
                pass

    def _finished(self, process: TrainingProcess, run: str) -> None:
        job = process.job
        if process is self.process:
            self.monitor.finish(f"Finished: {Path(run).name}")
        last = not self.queue.waiting and len(self.processes) == 1
        still_there = self.session.scene is None and (self.session.clip is None or self.session.clip.path == job.clip)
        if self._end(process) and still_there and last and self.documents is not None:
            self.documents.open_path(Path(run))
        else:
            self.shell.say(f"{run} is finished; open it from the File menu or Train ▸ Runs.", 30)

    def _stopped(self, process: TrainingProcess) -> None:
        paused = process in self._pausing
        if process is self.process:
            if paused:
                self.monitor.pause("Paused. The machine is free; Resume goes on exactly where it was.")
            else:
                self.monitor.cancelled("Stopped; the checkpoint can be resumed.")
        self._end(process, paused=paused)

    def _failed(self, process: TrainingProcess, message: str) -> None:
        if process is self.process:
            self.monitor.fail(message)
        if self._end(process):
            self.shell.show_error(message)

    def _end(self, process: TrainingProcess, paused: bool = False) -> bool:
        """Forget the process and turn to the next, or show another that runs. False when the window closes now."""
        self.processes = {number: other for number, other in self.processes.items() if other is not process}
        self._pausing.discard(process)
        self._stages.pop(process, None)
        process.deleteLater()
        if process is self.process:
            self.process = None
        self.queue.ended(process.job, paused=paused)
        if self._then is not None:
            if not self.running:
                then, self._then = self._then, None
                then()
            return False
        self._next()
        if self.process is None and self.processes:
            self._show(next(iter(self.processes.values())))
        self._name_running()
        return True
