"""Training in a process of its own, seen from the window: JSON lines in, `stop` out."""

from __future__ import annotations

import logging
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from PySide6.QtCore import QObject, QProcess, QProcessEnvironment, QTimer, Signal

from degense.app.features.train.job import TrainingJob
from degense.app.shell.logs import hide_names
from degense.engine.events import Done, Event, Failed, Stopped, from_json
from degense.engine.untrusted import parse_json

log = logging.getLogger(__name__)

SAVE_SECONDS, TERMINATE_SECONDS = 15.0, 5.0
MAX_LINE = 1 << 20


class EventLines:
    """Turns pieces of output into events. Other lines are handed back as text; overlong lines are dropped, not gathered."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, piece: bytes) -> tuple[list[Event], list[str]]:
        """Events and other lines that are complete now."""
        *lines, self._rest = (self._rest + piece).split(b"\n")
        if len(self._rest) > MAX_LINE:
            self._rest = b""
        events, others = [], []
        for line in lines:
            text = line.decode("utf-8", "replace").strip()
            try:
                event = from_json(parse_json(text))
            except ValueError:
                event = None
            if event is not None:
                events.append(event)
            elif text:
                others.append(text)
        return events, others


class TrainingProcess(QObject):
    """A running training, in a process with more variables in its environment.

    Exactly one of the last three is emitted.
    """

    told = Signal(object)  # (event) each `engine.events.Event` as it comes
    finished = Signal(str)  # (run path) training is complete
    stopped = Signal()  # it was stopped on request; a checkpoint is kept when it had got that far
    failed = Signal(str)  # (message) in words for the user

    def __init__(
        self,
        job: TrainingJob,
        parent: QObject | None = None,
        command: Sequence[str] | None = None,
        environment: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        super().__init__(parent)
        self.job = job
        self._command = list(command or [sys.executable, "-m", "degense.app", *job.arguments()])
        self._lines = EventLines()
        self._complaints: deque[str] = deque(maxlen=30)
        self._message: str | None = None
        self._run: str | None = None
        self._stopping, self.running = False, True
        self._process = QProcess(self)
        variables = QProcessEnvironment.systemEnvironment()
        for name, value in environment.items():
            variables.insert(name, value)
        self._process.setProcessEnvironment(variables)
        self._process.setWorkingDirectory(str(Path.cwd()))
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.readyReadStandardError.connect(self._read_complaints)
        self._process.finished.connect(self._on_finished)
        self._process.errorOccurred.connect(self._on_error)
        self._terminated = False
        self._patience = QTimer(self, singleShot=True)
        self._patience.timeout.connect(self._insist)

    def start(self) -> None:
        hide_names(*(Path(word) for word in self._command[1:] if Path(word).is_absolute()))
        log.info("starting %s", " ".join(self._command))
        self._process.start(self._command[0], self._command[1:])

    def stop(self) -> None:
        """Ask it to save and leave; if it does not, terminate it, and at last kill it. Returns at once."""
        if self._stopping or not self.running:
            return
        self._stopping = True
        self._process.write(b"stop\n")
        self._patience.start(round(SAVE_SECONDS * 1000))

    def _insist(self) -> None:
        if self._process.state() == QProcess.ProcessState.NotRunning:
            return
        if self._terminated:
            self._process.kill()
        else:
            self._process.terminate()
            self._terminated = True
            self._patience.start(round(TERMINATE_SECONDS * 1000))

    def _read(self) -> None:
        events, others = self._lines.feed(bytes(self._process.readAllStandardOutput().data()))
        for text in others:
            log.info("training says: %s", text[:500])
        for event in events:
            self._take(event)

    def _take(self, event: Event) -> None:
        match event:
            case Done(run):
                self._run = run
            case Failed(message):
                self._message = message
            case Stopped():
                self._stopping = True
        self.told.emit(event)

    def _read_complaints(self) -> None:
        for text in bytes(self._process.readAllStandardError().data()).decode("utf-8", "replace").splitlines():
            if text.strip():
                self._complaints.append(text.strip())
                log.warning("training: %s", text[:500])

    def _on_error(self, error: QProcess.ProcessError) -> None:
        if error == QProcess.ProcessError.FailedToStart:
            self._end()
            self.failed.emit(f"The training process could not be started ({self._process.errorString()}).")

    def _on_finished(self, code: int, status: QProcess.ExitStatus) -> None:
        if not self.running:
            return
        self._read()
        self._read_complaints()
        self._end()
        if self._message is not None:
            self.failed.emit(self._message)
        elif self._run is not None:
            self.finished.emit(self._run)
        elif self._stopping:
            self.stopped.emit()
        elif self._complaints and self._complaints[-1].startswith("degense: "):
            self.failed.emit(self._complaints[-1].removeprefix("degense: "))
        elif status == QProcess.ExitStatus.CrashExit:
            self.failed.emit("The training process was ended by the system, often for want of memory. Try a smaller preset, or resume.")
        else:
            self.failed.emit(f"The training process ended with status {code}; the log has the details.")

    def _end(self) -> None:
        self.running = False
        self._patience.stop()
