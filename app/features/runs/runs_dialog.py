"""Train ▸ Runs: the runs of a folder with settings and scores."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QProcess, Qt
from PySide6.QtWidgets import QDialogButtonBox, QHeaderView, QPushButton, QTableWidgetItem, QWidget

from degense.app.features.documents.controller import Documents
from degense.app.features.runs.run_summaries import SCORES, RunSummary, list_runs, training_answers
from degense.app.features.train.controller import Training
from degense.app.features.train.monitor import duration
from degense.app.shell.messages import show_error
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.widgets import forms


@dataclass(frozen=True)
class Column:
    """A column: its title, the value that sorts, how it is written, and what is best."""

    title: str
    value: Callable[[RunSummary], Any]
    words: Callable[[Any], str] = str
    best: Callable[[list[Any]], Any] | None = None
    help: str = ""


COLUMNS = (
    Column("Run", lambda run: run.name),
    Column("Clip", lambda run: run.clip),
    Column("State", lambda run: run.state),
    Column("Preset", lambda run: run.preset),
    Column("Routing", lambda run: run.routing),
    Column("Semantics", lambda run: run.teacher),
    Column("Steps", lambda run: run.iteration, lambda steps: f"{steps:,}"),
    Column("Gaussians", lambda run: run.gaussians, lambda count: f"{count:,}"),
    Column("Time", lambda run: run.train_seconds, duration, min, "of training"),
    Column("PSNR, training", lambda run: run.training_psnr, lambda value: f"{value:.2f} dB", max, "of training frames, at the last report"),
    Column("PSNR", lambda run: run.psnr, lambda value: f"{value:.2f} dB", max, "held-out frames, valid pixels"),
    Column("mIoU", lambda run: run.miou, lambda value: f"{value:.1%}", max, "held-out frames, decoder rnse"),
    Column(
        "Motion error", lambda run: run.displacement_error, lambda value: f"{value:.3g}", min, "mean, in the clip's unit; needs exact truth"
    ),
    Column("Begun", lambda run: run.created, lambda time: time[:16].replace("T", " ")),
)


class RunsDialog(forms.Dialog):
    """The list and its actions. The best of each score is bold."""

    def __init__(self, folder: Path, runs: Runs, parent: QWidget) -> None:
        super().__init__(parent, "runs", "Runs", 1180, 460)
        self._folder, self._runs = folder, runs
        self.summaries: list[RunSummary] = []
        self.where = forms.label(wrap=False)
        top = forms.row((self.where, 1), forms.button("Another folder…", self._choose))
        self.table = forms.table("Runs", [column.title for column in COLUMNS])
        self.table.setShowGrid(True)
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        self.table.horizontalHeader().setToolTip("; ".join(f"{about.title}: {about.help}" for about in COLUMNS if about.help))
        self.table.setSortingEnabled(True)
        self.table.sortByColumn(len(COLUMNS) - 1, Qt.SortOrder.DescendingOrder)
        self.table.itemSelectionChanged.connect(self._enable)
        self.table.itemDoubleClicked.connect(lambda item: self._open())
        self.open_button, self.resume_button = QPushButton("Open"), QPushButton("Resume")
        self.score_button, self.reuse_button = QPushButton("Score"), QPushButton("Train again like this…")
        self.score_button.setToolTip("Compare it with its held-out frames; takes up to a few minutes")
        self.reuse_button.setToolTip("The training dialog with the settings of this run, for the clip that is open")
        self.open_button.clicked.connect(self._open)
        self.score_button.clicked.connect(lambda: runs.score(self._chosen()))
        self.resume_button.clicked.connect(self._resume)
        self.reuse_button.clicked.connect(self._reuse)
        buttons = self.closing()
        for button in (self.open_button, self.score_button, self.resume_button, self.reuse_button):
            buttons.addButton(button, QDialogButtonBox.ButtonRole.ActionRole)
        forms.column(top, (self.table, 1), buttons, margin=9, parent=self)
        self.refresh()

    def refresh(self) -> None:
        """Read the folder again; the chosen run stays chosen."""
        chosen = self._chosen().path if self.table.selectedItems() else None
        try:
            self.summaries = list_runs(self._folder)
        except DegenseError as error:
            self.summaries = []
            show_error(self, str(error))
        self.where.setText(f"{self._folder}: {len(self.summaries) or 'no'} run{'' if len(self.summaries) == 1 else 's'}")
        self.table.setSortingEnabled(False)
        self.table.setRowCount(len(self.summaries))
        for column, about in enumerate(COLUMNS):
            values = [about.value(run) for run in self.summaries]
            known = [value for value in values if value is not None]
            best = about.best(known) if about.best and len(known) > 1 else None
            for row, value in enumerate(values):
                item = _Cell(value, "–" if value is None else about.words(value))
                item.setData(Qt.ItemDataRole.UserRole, row)
                font = item.font()
                font.setBold(best is not None and value == best)
                item.setFont(font)
                self.table.setItem(row, column, item)
        self.table.setSortingEnabled(True)
        self.table.resizeColumnsToContents()
        paths = [run.path for run in self.summaries]
        if paths:
            wanted = paths.index(chosen) if chosen in paths else 0
            self.table.selectRow(self._rows().index(wanted))
        self._enable()

    def _rows(self) -> list[int]:
        """Which summary each row of the table shows, in its present order."""
        model = self.table.model()
        return [model.index(row, 0).data(Qt.ItemDataRole.UserRole) for row in range(self.table.rowCount())]

    def _chosen(self) -> RunSummary:
        return self.summaries[self.table.selectedItems()[0].data(Qt.ItemDataRole.UserRole)]

    def _enable(self) -> None:
        run = self._chosen() if self.table.selectedItems() else None
        finished = run is not None and run.state == "finished"
        self.open_button.setEnabled(finished)
        self.score_button.setEnabled(finished and not self._runs.scoring)
        self.score_button.setText("Scoring…" if self._runs.scoring else "Score")
        self.resume_button.setEnabled(run is not None and run.resumable and not self._runs.busy_with(run.path))
        self.reuse_button.setEnabled(run is not None and run.state != "damaged" and self._runs.session.clip is not None)

    def _open(self) -> None:
        if self._chosen().state == "finished":
            self._runs.documents.open_path(self._chosen().path)

    def _resume(self) -> None:
        self._runs.training.resume(self._chosen().path)
        self.accept()

    def _reuse(self) -> None:
        if self._runs.reuse(self._chosen().path):
            self.accept()

    def _choose(self) -> None:
        if (folder := self._runs.shell.ask_folder("Folder with runs", str(self._folder))) is not None:
            self._folder = folder
            self.refresh()


class Runs(QObject):
    """Shows the list, and scores runs in a process of its own."""

    def __init__(self, shell: Shell, documents: Documents, training: Training) -> None:
        super().__init__(shell)
        self.shell, self.session, self.settings = shell, shell.session, shell.settings
        self.documents, self.training = documents, training
        shell.closed.connect(self.stop)
        self._process: QProcess | None = None

    def show(self) -> None:
        """The runs beside what is open, else beside what was opened last."""
        session = self.session
        path = session.scene.run.path if session.scene else session.clip.path if session.clip else None
        folder = path.resolve().parent if path is not None else Path(self.settings.value.last_folder or Path.home())
        RunsDialog(folder, self, self.shell).show()

    @property
    def scoring(self) -> bool:
        return self._process is not None

    def busy_with(self, run: Path) -> bool:
        """Whether a run is being trained, or waits for it."""
        return any(job.out.resolve() == run.resolve() for job in self.training.queue.jobs)

    def reuse(self, run: Path) -> bool:
        """Show the training dialog with the settings of a run; whether it could be."""
        try:
            self.settings.update(training=training_answers(run))
        except DegenseError as error:
            self.shell.show_error(str(error))
            return False
        self.training.ask()
        return True

    def score(self, run: RunSummary) -> None:
        """Score a run; the list shows it when it is done."""
        process = QProcess(self)
        process.finished.connect(lambda code, status: self._scored(run, code))
        self._process = process
        process.start(sys.executable, ["-m", "degense.app", "eval", str(run.path), "--json", str(run.path / SCORES)])
        self.shell.set_busy(f"Scoring {run.name}")
        self._refresh()

    def stop(self) -> None:
        """Stop scoring, for the window closes."""
        if self._process is not None:
            self._process.finished.disconnect()
            self._process.kill()
            self._process.waitForFinished(5000)
            self._process = None

    def _scored(self, run: RunSummary, code: int) -> None:
        assert self._process is not None
        said = bytes(self._process.readAllStandardError().data()).decode("utf-8", "replace").strip().splitlines()
        self._process.deleteLater()
        self._process = None
        self.shell.set_busy()
        if code:
            reason = said[-1].removeprefix("degense: ") if said else f"status {code}"
            self.shell.show_error(f"{run.name} could not be scored: {reason}")
        self._refresh()

    def _refresh(self) -> None:
        for dialog in self.shell.findChildren(RunsDialog):
            dialog.refresh()


class _Cell(QTableWidgetItem):
    """Sorts by its value; what is not known comes last."""

    def __init__(self, value: Any, words: str) -> None:
        super().__init__(words)
        self.value = value
        if isinstance(value, int | float):
            self.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)

    def __lt__(self, other: QTableWidgetItem) -> bool:
        if not isinstance(other, _Cell) or self.value is None or other.value is None:
            return isinstance(other, _Cell) and self.value is not None
        return bool(self.value < other.value)
