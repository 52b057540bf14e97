"""The training dialog: what to train, and its cost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtWidgets import (
    QComboBox,
    QDialogButtonBox,
    QFileDialog,
    QGridLayout,
    QLabel,
    QWidget,
)

from degense.app.features.train import settings_help as words
from degense.app.features.train.job import TrainingJob
from degense.app.features.train.settings_table import SettingsTable
from degense.app.session.sample import is_demo
from degense.engine.errors import DegenseError
from degense.engine.files import free_path
from degense.engine.semantics.teachers import default_teacher, teacher_choices
from degense.widgets import forms
from degense.widgets.scrolling import scrolled

if TYPE_CHECKING:
    from degense.engine.clip import Clip


#: What the empty field says, for the teachers that have a folder.
EMPTY = {"precomputed": "beside the clip", "vlm": "of the model"}


class TrainDialog(forms.Dialog):
    """Asks for a `TrainingJob`. Every choice is explained, and cost and errors are shown at once.

    `answers` are what the user has chosen for the clip (`ClipOptions`), `last` those of the last training (`TrainingJob.answers`); it is
    `queued` when another training runs, so that this one will wait.
    """

    def __init__(self, clip: Clip, answers: dict[str, Any], last: dict[str, Any], queued: bool, parent: QWidget) -> None:
        super().__init__(parent, "train", f"Train {clip.name}", 880, 640)
        self._clip, self._answers = clip, answers
        self.preset = _choice("Quality", words.PRESET_WORDS)
        self.routing = _choice("Gradient routing", words.ROUTING_WORDS)
        self._teachers = {choice.name: choice for choice in teacher_choices(clip)}
        self.teacher = _choice("Semantics from", words.teacher_words(self._teachers.values()))
        self.folder = forms.PathLine("Teacher's folder", lambda at: QFileDialog.getExistingDirectory(self, "The teacher's folder", at))
        self.device = _choice("Device", words.DEVICE_WORDS)
        self.poses = _choice("Camera", words.POSES_WORDS)
        self.iterations = forms.number("Iterations", most=1_000_000, step=500, zero="as the preset")
        self.max_gaussians = forms.number("Gaussians", most=5_000_000, step=5000, zero="as the preset")
        self.seed = forms.number("Seed", most=2**31 - 1)
        self._place = forms.PathLine("Run folder", lambda at: QFileDialog.getSaveFileName(self, "Folder for the run", at, "")[0])
        self.out = self._place.line
        beside = Path.home() if is_demo(clip.path) else clip.path.parent  # the sample is part of the program
        self.out.setText(str(free_path(beside / f"{clip.path.stem}-run")))
        names = ("preset", "routing", "teacher", "device", "poses", "iterations", "max_gaussians", "seed")
        self._controls: dict[str, QWidget] = {name: getattr(self, name) for name in names}
        self.table = SettingsTable()
        self.cost, self.complaint = forms.named(QLabel(wordWrap=True), "Cost"), forms.complaint()
        self.buttons = QDialogButtonBox()
        self.start = self.buttons.addButton("Add to queue" if queued else "Start", QDialogButtonBox.ButtonRole.AcceptRole)
        self.buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.reset = self.buttons.addButton("Defaults", QDialogButtonBox.ButtonRole.ResetRole)
        self.buttons.accepted.connect(self.accept)
        self.buttons.rejected.connect(self.reject)
        self.reset.clicked.connect(lambda: self.fill({}))
        forms.column(
            (forms.tabs(Choices=scrolled(self._choices()), All_settings=self.table), 1),
            self.cost,
            self.complaint,
            self.buttons,
            margin=9,
            parent=self,
        )
        self.fill(last)
        changes = (self.folder.line.textChanged, self.out.textChanged, self.table.changed)
        for changed in (*changes, *map(forms.changed, self._controls.values())):
            changed.connect(self._update)
        self._update()

    def job(self) -> TrainingJob:
        said = {name: forms.value(control) for name, control in self._controls.items()}
        if said["teacher"] in EMPTY and (place := self.folder.line.text().strip()):
            said["teacher"] += f":{place}"
        settings = tuple(sorted(self.table.typed.items()))
        return TrainingJob(self._clip.path, Path(self.out.text()), settings=settings, **(self._answers | said))

    def fill(self, answers: dict[str, Any]) -> None:
        """Show the answers of an earlier training; the rest is as in a fresh dialog, and so is a teacher that this clip lacks."""
        job = TrainingJob(self._clip.path, Path(), routing="isolated", device="auto", seed=0).with_answers(answers)
        kind, _, place = (job.teacher or "").partition(":")
        if kind not in self._teachers or not (place or self._teachers[kind].available):
            kind, place = default_teacher(self._clip), ""
        self.folder.line.setText(place)
        given = {**vars(job), "teacher": kind, "poses": self._answers.get("poses", "auto")}
        for name, control in self._controls.items():
            forms.enter(control, given[name])
        self.table.typed = dict(job.settings)
        self._update()

    def _choices(self) -> QWidget:
        page = QWidget()
        grid = QGridLayout(page)
        grid.setColumnStretch(2, 1)
        grid.setHorizontalSpacing(14)
        grid.setVerticalSpacing(9)
        rows: tuple[tuple[str, QWidget, dict[str, tuple[str, str]] | str], ...] = (
            ("Quality", self.preset, words.PRESET_WORDS),
            ("Semantics from", self.teacher, words.teacher_words(self._teachers.values())),
            ("Teacher's folder", self.folder, words.TEACHER_FOLDER_WORDS),
            ("Gradient routing", self.routing, words.ROUTING_WORDS),
            ("Camera", self.poses, words.POSES_WORDS),
            ("Device", self.device, words.DEVICE_WORDS),
            ("Iterations", self.iterations, words.ITERATION_WORDS),
            ("Gaussians", self.max_gaussians, words.GAUSSIAN_WORDS),
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
        grid.addWidget(self._place, len(rows), 1, 1, 2)
        grid.addWidget(forms.label(words.OUT_WORDS, secondary=True), len(rows) + 1, 1, 1, 2)
        grid.setRowStretch(len(rows) + 2, 1)
        return page

    def _update(self) -> None:
        from degense.engine.training import estimate

        kind = self.teacher.currentData()
        self.folder.line.setPlaceholderText(EMPTY.get(kind, "not needed"))
        self.folder.setEnabled(kind in EMPTY)
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
