"""The training dialog: what to train, and its cost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QGridLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QTabWidget,
    QWidget,
)

from degense.app.features.train import settings_help as words
from degense.app.features.train.job import TrainingJob
from degense.app.features.train.settings_table import SettingsTable
from degense.engine.errors import DegenseError
from degense.engine.files import free_path
from degense.engine.semantics.teachers import default_teacher, teacher_choices
from degense.widgets import forms

if TYPE_CHECKING:
    from degense.engine.clip import Clip


#: What the empty field says, for the teachers that have a folder.
EMPTY = {"precomputed": "beside the clip", "vlm": "of the model"}


class TeacherFolder(QWidget):
    """A folder, typed or chosen, that follows the kind of teacher.

    Signals
    -------
    changed()
    """

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._kind = ""
        self.line = QLineEdit()
        self.line.setAccessibleName("Teacher's folder")
        self.line.textChanged.connect(self.changed)
        self.choose = QPushButton("Choose…")
        self.choose.setAccessibleName("Choose the teacher's folder")
        self.choose.clicked.connect(self._browse)
        forms.row((self.line, 1), self.choose, parent=self)

    def follow(self, kind: str) -> None:
        """Show what a kind of teacher needs; most have no folder."""
        self._kind = kind
        self.line.setPlaceholderText(EMPTY.get(kind, "not needed"))
        self.setEnabled(kind in EMPTY)

    @property
    def teacher(self) -> str:
        """The teacher's name as the command line takes it."""
        place = self.line.text().strip() if self._kind in EMPTY else ""
        return f"{self._kind}:{place}" if place else self._kind

    def _browse(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, "The teacher's folder", self.line.text())
        if folder:
            self.line.setText(folder)


class TrainDialog(QDialog):
    """Asks for a `TrainingJob`. Every choice is explained, and cost and errors are shown at once.

    Parameters
    ----------
    answers : dict
        What the user has chosen for the clip (`ClipOptions`).
    last : dict
        The answers of the last training (`TrainingJob.answers`).
    queued : bool
        Whether another training runs, so that this one will wait.
    """

    def __init__(self, clip: Clip, answers: dict[str, Any], last: dict[str, Any], queued: bool, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("train")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(f"Train {clip.name}")
        self.resize(880, 640)
        self._clip, self._answers = clip, answers
        self.preset = _choice("Quality", words.PRESET_WORDS)
        self.routing = _choice("Gradient routing", words.ROUTING_WORDS)
        self._teachers = {choice.name: choice for choice in teacher_choices(clip)}
        self.teacher = _choice("Semantics from", words.teacher_words(self._teachers.values()))
        self.folder = TeacherFolder()
        self.device = _choice("Device", words.DEVICE_WORDS)
        self.poses = _choice("Camera", words.POSES_WORDS)
        self.fit = QCheckBox("Fit the budget to the clip")
        self.iterations = forms.number("Iterations", most=1_000_000, step=500, zero="as the preset")
        self.gaussians = forms.number("Gaussians", most=5_000_000, step=5000, zero="as the preset")
        self.seed = forms.number("Seed", most=2**31 - 1)
        self.out = QLineEdit(str(free_path(clip.path.parent / f"{clip.path.stem}-run")))
        self.out.setAccessibleName("Run folder")
        self.table = SettingsTable()
        self.cost, self.complaint = QLabel(), forms.complaint()
        self.cost.setWordWrap(True)
        self.cost.setAccessibleName("Cost")
        self.buttons = QDialogButtonBox()
        self.start = self.buttons.addButton("Add to queue" if queued else "Start", QDialogButtonBox.ButtonRole.AcceptRole)
        self.buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.reset = self.buttons.addButton("Defaults", QDialogButtonBox.ButtonRole.ResetRole)
        self.buttons.accepted.connect(self.accept)
        self.buttons.rejected.connect(self.reject)
        self.reset.clicked.connect(lambda: self.fill({}))
        tabs = QTabWidget()
        tabs.setDocumentMode(True)
        tabs.addTab(self._choices(), "Choices")
        tabs.addTab(self.table, "All settings")
        tabs.setAccessibleName("Pages")
        forms.column((tabs, 1), self.cost, self.complaint, self.buttons, margin=9, parent=self)
        self.fill(last)
        boxes = (self.preset, self.routing, self.teacher, self.device, self.poses)
        changes = [*(box.currentIndexChanged for box in boxes), self.folder.changed, self.fit.toggled, self.out.textChanged]
        changes += [self.table.changed, *(number.valueChanged for number in (self.iterations, self.gaussians, self.seed))]
        for changed in changes:
            changed.connect(self._update)
        self._update()

    def job(self) -> TrainingJob:
        job = TrainingJob(
            clip=self._clip.path,
            out=Path(self.out.text()),
            preset=self.preset.currentData(),
            routing=self.routing.currentData(),
            teacher=self.folder.teacher,
            iterations=self.iterations.value() or None,
            max_gaussians=self.gaussians.value() or None,
            device=self.device.currentData(),
            seed=self.seed.value(),
            fit=self.fit.isChecked(),
            settings=tuple(sorted(self.table.typed.items())),
        )
        return replace(job, **(self._answers | {"poses": self.poses.currentData()}))

    def fill(self, answers: dict[str, Any]) -> None:
        """Show the answers of an earlier training; the rest is as in a fresh dialog, and so is a teacher that this clip lacks."""
        job = TrainingJob(self._clip.path, Path(), routing="isolated", device="auto", seed=0).with_answers(answers)
        kind, _, place = (job.teacher or "").partition(":")
        if kind not in self._teachers or not (place or self._teachers[kind].available):
            kind, place = default_teacher(self._clip), ""
        self.folder.line.setText(place)
        choices = (
            (self.preset, job.preset),
            (self.routing, job.routing),
            (self.teacher, kind),
            (self.device, job.device),
            (self.poses, self._answers.get("poses", "auto")),
        )
        for box, value in choices:
            box.setCurrentIndex(max(0, box.findData(value)))
        self.iterations.setValue(job.iterations or 0)
        self.gaussians.setValue(job.max_gaussians or 0)
        self.seed.setValue(job.seed or 0)
        self.fit.setChecked(job.fit)
        self.table.typed = dict(job.settings)
        self._update()

    def _choices(self) -> QWidget:
        page = QWidget()
        grid = QGridLayout(page)
        grid.setColumnStretch(2, 1)
        grid.setHorizontalSpacing(14)
        grid.setVerticalSpacing(9)
        browse = QPushButton("Choose…")
        browse.clicked.connect(self._browse)
        folder = QWidget()
        forms.row((self.out, 1), browse, parent=folder)
        rows: tuple[tuple[str, QWidget, dict[str, tuple[str, str]] | str], ...] = (
            ("Quality", self.preset, words.PRESET_WORDS),
            ("Semantics from", self.teacher, words.teacher_words(self._teachers.values())),
            ("Teacher's folder", self.folder, words.TEACHER_FOLDER_WORDS),
            ("Gradient routing", self.routing, words.ROUTING_WORDS),
            ("Camera", self.poses, words.POSES_WORDS),
            ("Device", self.device, words.DEVICE_WORDS),
            ("Budget", self.fit, words.FIT_WORDS),
            ("Iterations", self.iterations, words.ITERATION_WORDS),
            ("Gaussians", self.gaussians, words.GAUSSIAN_WORDS),
            ("Seed", self.seed, words.SEED_WORDS),
        )
        for row, (title, control, said) in enumerate(rows):
            name = QLabel(title)
            name.setBuddy(control)
            control.setMinimumWidth(210)
            grid.addWidget(name, row, 0)
            grid.addWidget(control, row, 1)
            grid.addWidget(_explained(control, said), row, 2)
        grid.addWidget(QLabel("Run folder"), len(rows), 0)
        grid.addWidget(folder, len(rows), 1, 1, 2)
        grid.addWidget(forms.label(words.OUT_WORDS, secondary=True), len(rows) + 1, 1, 1, 2)
        grid.setRowStretch(len(rows) + 2, 1)
        return page

    def _update(self) -> None:
        from degense.engine.training import estimate

        self.folder.follow(self.teacher.currentData())
        job, problem = self.job(), ""
        try:
            config = job.config()
            self.table.show_config(config)
            self.cost.setText(f"<b>Cost:</b> {estimate(self._clip, config)['words']}.")
        except DegenseError as error:
            self.cost.setText("<b>Cost:</b> –")
            problem = str(error)
        if job.teacher in self._teachers and not self._teachers[job.teacher].available:
            problem = words.sentence(self._teachers[job.teacher].reason)
        if not self.out.text().strip():
            problem = "Choose a folder for the run."
        elif job.out.is_file() or (job.out.is_dir() and any(job.out.iterdir())):
            problem = f"{job.out} is not empty; choose another folder."
        self.complaint.setText(problem)
        self.complaint.setVisible(bool(problem))
        self.start.setEnabled(not problem)

    def _browse(self) -> None:
        folder = QFileDialog.getSaveFileName(self, "Folder for the run", self.out.text(), "")[0]
        if folder:
            self.out.setText(folder)


def _choice(name: str, entries: dict[str, tuple[str, str]]) -> QComboBox:
    """A menu of value to (title, explanation)."""
    return forms.choice(name, [(value, *about) for value, about in entries.items()])


def _explained(control: QWidget, said: dict[str, tuple[str, str]] | str) -> QLabel:
    """What a choice does; it follows the choice."""
    label = forms.label(said if isinstance(said, str) else "", secondary=True)
    if isinstance(control, QComboBox) and not isinstance(said, str):

        def show() -> None:
            label.setText(said[control.currentData()][1])

        control.currentIndexChanged.connect(show)
        show()
    return label
