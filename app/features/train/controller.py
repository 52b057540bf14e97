"""Train ▸ Start, Pause and Cancel: dialog, queue, process and monitor."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from filelock import FileLock
from PySide6.QtCore import QObject
from PySide6.QtWidgets import QMessageBox

from degense.app.features.documents.controller import Documents
from degense.app.features.train.job import CLIP_OPTIONS, TrainingJob, TrainingQueue
from degense.app.features.train.monitor import TrainingMonitor
from degense.app.features.train.process import TrainingProcess
from degense.app.shell.messages import Choice
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.engine.events import Done, Event, Failed, Preview, Reliability, Rollback, Stage, Step, Stopped, TrainingProgress, read_progress

log = logging.getLogger(__name__)

STAGES = {
    "poses": "Finding the camera",
    "load": "Reading the clip",
    "teacher": "Asking the teacher what is where",
    "flow": "Measuring motion",
    "coarse": "Coarse: static Gaussians",
    "joint": "Joint: motion, colour and semantics",
    "semantics": "Semantics: what is where",
}


class Training(QObject):
    """One training at a time, beside everything else; others wait in the queue."""

    def __init__(self, shell: Shell) -> None:
        super().__init__(shell)
        self.shell, self.session, self.worker, self.documents = shell, shell.session, shell.worker, shell.service(Documents)
        self.monitor = TrainingMonitor()
        self.dock = shell.add_dock("Training", self.monitor)
        self.queue = TrainingQueue()
        self.process: TrainingProcess | None = None
        self._kept: tuple[dict[str, Any], ...] = ()
        self._pausing = False
        self._observed: tuple[int, np.ndarray] | None = None
        self._then: Callable[[], object] | None = None
        monitor = self.monitor
        monitor.cancel_requested.connect(self.cancel)
        monitor.pause_requested.connect(self.pause)
        monitor.resume_requested.connect(self.resume_paused)
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
        return self.process is not None and self.process.running

    def ask(self, labels: Path | None = None) -> None:
        """Show the dialog, and start or queue what it says; a folder of label maps becomes the teacher."""
        clip, answers = self.session.clip, self.documents.clip_options if self.documents is not None else {}
        if clip is None:
            return
        if labels is not None:
            from degense.engine.data.readers import with_labels

            clip, answers = with_labels(clip, labels), {**answers, "labels": str(labels)}
        settings = self.shell.settings
        busy = self.running or self.queue.paused is not None
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
            self.queue.add(job)
            if self.running or self.queue.paused is not None:
                self.shell.say(f"{job.out.name} waits for its turn.")
            self._next()

        self.shell.attempt(add)

    def pause(self) -> None:
        """Let the training save, and leave the machine to others until `resume_paused`."""
        if self.process is not None and self.process.running:
            self._pausing = True
            self.process.stop()

    def resume_paused(self) -> None:
        self.queue.resume()
        self._next()

    def cancel(self) -> None:
        """Ask it to save and stop; one that is paused has done so, and makes room for the next to be paused."""
        if self.process is not None:
            self._pausing = False
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
        """Train in a process of its own, if it is anybody's turn."""
        job = self.queue.next()
        if job is None:
            return
        process = TrainingProcess(job, self)
        process.told.connect(self._take)
        process.finished.connect(self._finished)
        process.stopped.connect(self._stopped)
        process.failed.connect(self._failed)
        self.process, self._pausing, self._observed = process, False, None
        self._show_monitor(job)
        process.start()
        self.shell.refresh()

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
        waiting = len(self.queue.waiting)
        others = f", and so is the queue of {waiting}" if waiting else ""

        def stop() -> None:
            self._then = close
            self.pause()

        self.shell.ask(
            "training runs",
            f"A training is running. Stop it and close? It saves a checkpoint; at the next start it is offered again{others}.",
            Choice("Stop and save", stop),
            Choice("Keep it running", escape=True),
            icon=QMessageBox.Icon.NoIcon,
        )
        return False

    def _take(self, event: Event) -> None:
        monitor = self.monitor
        match event:
            case Stage(stage):
                monitor.set_stage(STAGES.get(stage, stage))
            case Step(stage, fraction):
                monitor.set_stage(f"{STAGES.get(stage, stage)}: {fraction:.0%}")
            case TrainingProgress():
                monitor.set_progress(event)
            case Preview(path, frame):
                self._preview(path, frame)
            case Reliability(words):
                monitor.note(words)
            case Rollback(iteration, reason):
                monitor.note(f"went back to iteration {iteration}: {reason}")
            case Done() | Stopped() | Failed():  # the process says so when it has ended
                pass

    def _preview(self, path: str, frame: int) -> None:
        """Show a preview at once, and beside it the recorded frame, which the worker reads the first time."""
        picture = cv2.imread(path, cv2.IMREAD_COLOR)
        if picture is None or self.process is None:
            return
        job = self.process.job
        known = self._observed is not None and self._observed[0] == frame
        self.monitor.set_preview(picture[..., ::-1].copy(), self._observed[1] if known and self._observed else None)
        if not known and not self.worker.busy("observed"):

            def found(rgb: np.ndarray) -> None:
                if self.process is not None and self.process.job is job:
                    self._observed = (frame, rgb)
                    self.monitor.set_preview(picture[..., ::-1].copy(), rgb)

            self.worker.submit("observed", lambda: _recorded(job, frame), found, log.warning)

    def _finished(self, run: str) -> None:
        assert self.process is not None
        job = self.process.job
        self.monitor.finish(f"Finished: {Path(run).name}")
        nothing_waits = not self.queue.waiting
        still_there = self.session.scene is None and (self.session.clip is None or self.session.clip.path == job.clip)
        if self._end() and still_there and nothing_waits and self.documents is not None:
            self.documents.open_path(Path(run))
        else:
            self.shell.say(f"{run} is finished; open it from the File menu or Train ▸ Runs.", 30)

    def _stopped(self) -> None:
        if self._pausing:
            self.monitor.pause("Paused. The machine is free; Resume goes on exactly where it was.")
        else:
            self.monitor.cancelled("Stopped; the checkpoint can be resumed.")
        self._end(paused=self._pausing)

    def _failed(self, message: str) -> None:
        self.monitor.fail(message)
        if self._end():
            self.shell.show_error(message)

    def _end(self, paused: bool = False) -> bool:
        """Forget the process and turn to the next. False when the window closes now."""
        assert self.process is not None
        self.process.deleteLater()
        self.process = None
        self.queue.ended(paused=paused)
        then, self._then = self._then, None
        if then is not None:
            then()
        else:
            self._next()
        return then is None


def _recorded(job: TrainingJob, frame: int) -> np.ndarray:
    """A frame of the clip that a job trains on, as it was recorded."""
    from degense.engine.data.readers import ClipOptions, open_clip

    return open_clip(job.clip, ClipOptions(**job.clip_options())).frame(frame)
