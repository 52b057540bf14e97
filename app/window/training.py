"""Train ▸ Start and Cancel: dialog, process and monitor."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import QFileDialog, QMessageBox

from app.session import Session
from app.training_process import TrainingJob, TrainingProcess
from app.window.messages import show_error
from app.window.opening import Opening
from app.window.parts import Parts
from app.window.train_dialog import TrainDialog
from engine.errors import DegenseError

STAGES = {
    "poses": "Finding the camera",
    "load": "Reading the clip",
    "teacher": "Asking the teacher what is where",
    "flow": "Measuring motion",
    "coarse": "Coarse: still Gaussians",
    "joint": "Joint: motion, colour and meaning",
    "meaning": "Meaning: what is where",
    "bake": "Saving",
    "done": "Done",
}


class Training(QObject):
    """One training at a time, beside everything else.

    Signals
    -------
    changed()
        Whether a training runs has changed.
    """

    changed = Signal()

    def __init__(self, session: Session, parts: Parts, opening: Opening) -> None:
        super().__init__(parts)
        self.session, self.parts, self.opening = session, parts, opening
        self.process: TrainingProcess | None = None
        self._then: Callable[[], object] | None = None
        parts.monitor.cancel_requested.connect(self.cancel)
        parts.facts.train_requested.connect(self.ask)

    @property
    def running(self) -> bool:
        return self.process is not None and self.process.running

    def ask(self) -> None:
        """Show the dialog, and start what it says."""
        if self.session.clip is None or self.running:
            return
        dialog = TrainDialog(self.session.clip, self.opening.clip_answers, self.parts.window)
        dialog.setObjectName("train")
        dialog.accepted.connect(lambda: self.start(dialog.job()))
        dialog.finished.connect(dialog.deleteLater)
        dialog.open()

    def ask_to_resume(self) -> None:
        """Ask for a run folder whose training was stopped, and go on with it."""
        folder = QFileDialog.getExistingDirectory(
            self.parts.window, "Resume the training of a run", self.opening.settings.value.last_folder
        )
        if folder:
            self.resume(Path(folder))

    def resume(self, run: Path) -> None:
        from engine.store import Run

        try:
            info = Run.open(run).info
        except DegenseError as error:
            show_error(self.parts.window, str(error))
            return
        self.start(TrainingJob(clip=(run / str(info["clip"]["path"])).resolve(), out=run, resume=True))

    def start(self, job: TrainingJob) -> None:
        """Train in a process of its own."""
        process = TrainingProcess(job, self)
        process.told.connect(self._take)
        process.finished.connect(self._finished)
        process.stopped.connect(self._stopped)
        process.failed.connect(self._failed)
        self.process = process
        self.parts.monitor_dock.show()
        self.parts.monitor_dock.raise_()
        self.parts.window.resizeDocks([self.parts.monitor_dock], [280], Qt.Orientation.Vertical)
        self.parts.monitor.start(f"{job.clip.name} → {job.out.name}")
        process.start()
        self.changed.emit()

    def cancel(self) -> None:
        """Ask it to save and stop."""
        if self.process is not None:
            self.process.stop()

    def may_close(self, close: Callable[[], object]) -> bool:
        """Whether the window may close now. If a training runs, the user is asked, and `close` is called once it has stopped."""
        if not self.running:
            return True
        box = QMessageBox(self.parts.window)
        box.setObjectName("training runs")
        box.setWindowTitle("DeGense")
        box.setText("A training is running. Stop it and close? It saves a checkpoint, and can be resumed.")
        stop = box.addButton("Stop and save", QMessageBox.ButtonRole.AcceptRole)
        box.addButton("Keep it running", QMessageBox.ButtonRole.RejectRole)

        def answered() -> None:
            if box.clickedButton() is stop:
                self._then = close
                self.cancel()

        box.finished.connect(answered)
        box.finished.connect(box.deleteLater)
        box.open()
        return False

    def _take(self, event: dict[str, Any]) -> None:
        monitor, kind = self.parts.monitor, event["event"]
        if kind == "stage":
            monitor.set_stage(STAGES.get(event.get("stage", ""), str(event.get("stage", ""))))
        elif kind == "step":
            monitor.set_stage(f"{STAGES.get(event.get('stage', ''), '')}: {event.get('fraction', 0):.0%}")
        elif kind == "progress" and "iteration" in event and "iterations" in event:
            names = ("loss", "psnr", "gaussians", "seconds", "eta")
            monitor.set_progress(event["iteration"], event["iterations"], **{name: event.get(name) for name in names})
        elif kind == "preview":
            picture = cv2.imread(str(event.get("path", "")), cv2.IMREAD_COLOR)
            if picture is not None:
                monitor.set_preview(picture[..., ::-1].copy())
        elif kind == "budget":
            monitor.note("\n".join(event.get("words", ())))
        elif kind == "rollback":
            monitor.note(f"went back to iteration {event.get('iteration')}: {event.get('reason')}")

    def _finished(self, run: str) -> None:
        assert self.process is not None
        job = self.process.job
        self.parts.monitor.finish(f"Finished: {Path(run).name}")
        still_there = self.session.scene is None and (self.session.clip is None or self.session.clip.path == job.clip)
        if self._end() and still_there:
            self.opening.open_path(Path(run))
        else:
            self.parts.say(f"{run} is finished; open it from the File menu.", 30)

    def _stopped(self) -> None:
        self.parts.monitor.cancelled("Stopped; the checkpoint can be resumed.")
        self._end()

    def _failed(self, message: str) -> None:
        self.parts.monitor.fail(message)
        if self._end():
            show_error(self.parts.window, message)

    def _end(self) -> bool:
        """Forget the process. False when the window closes now."""
        assert self.process is not None
        self.process.deleteLater()
        self.process = None
        self.changed.emit()
        then, self._then = self._then, None
        if then is not None:
            then()
        return then is None
