"""What to train, and what it will cost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from app.training_process import TrainingJob
from engine.errors import DegenseError

if TYPE_CHECKING:
    from engine.clip import Clip

PRESET_WORDS = (("quick", "Quick: a first look"), ("balanced", "Balanced"), ("best", "Best: for results"))
ROUTING_WORDS = (
    ("isolated", "Isolated: meaning never moves tissue"),
    ("paper", "Paper: shared encoder, two branches"),
    ("coupled", "Coupled: the rigid baseline"),
)
TEACHER_WORDS = (
    ("labels", "Labels: the clip's label maps"),
    ("strokes", "Strokes: scribbles beside the clip"),
    ("precomputed", "Precomputed feature files"),
    ("vlm", "A local vision-language model"),
    ("none", "None: geometry only, no prompts"),
)
DEVICE_WORDS = (("auto", "Automatic"), ("cpu", "Processor"), ("cuda", "CUDA GPU"))


class TrainDialog(QDialog):
    """Asks for a `TrainingJob`. The estimate follows each change; an unusable folder is said before the start, not after."""

    def __init__(self, clip: Clip, answers: dict[str, Any], parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle(f"Train {clip.name}")
        self.setMinimumWidth(520)
        self._clip, self._answers = clip, answers
        self.preset = _combo(PRESET_WORDS, "balanced")
        self.routing = _combo(ROUTING_WORDS, "isolated")
        self.teacher = _combo(TEACHER_WORDS, "labels" if clip.labelled_frames else "none")
        self.device = _combo(DEVICE_WORDS, "auto")
        self.iterations = QSpinBox()
        self.iterations.setRange(0, 1_000_000)
        self.iterations.setSingleStep(500)
        self.iterations.setSpecialValueText("as the preset")
        self.seed = QSpinBox()
        self.seed.setRange(0, 2**31 - 1)
        self.out = QLineEdit(str(_free_folder(clip.path.parent / f"{clip.path.stem}-run")))
        browse = QPushButton("Choose…")
        browse.clicked.connect(self._browse)
        folder = QHBoxLayout()
        folder.addWidget(self.out, 1)
        folder.addWidget(browse)
        self.cost = QLabel()
        self.cost.setWordWrap(True)
        self.complaint = QLabel()
        self.complaint.setWordWrap(True)
        self.buttons = QDialogButtonBox()
        self.start = self.buttons.addButton("Start", QDialogButtonBox.ButtonRole.AcceptRole)
        self.buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.buttons.accepted.connect(self.accept)
        self.buttons.rejected.connect(self.reject)
        form = QFormLayout()
        form.addRow("Quality", self.preset)
        form.addRow("Meaning from", self.teacher)
        form.addRow("Gradient routing", self.routing)
        form.addRow("Device", self.device)
        form.addRow("Iterations", self.iterations)
        form.addRow("Seed", self.seed)
        form.addRow("Run folder", folder)
        form.addRow("Cost", self.cost)
        column = QVBoxLayout(self)
        column.addLayout(form)
        column.addWidget(self.complaint)
        column.addWidget(self.buttons)
        for box in (self.preset, self.routing, self.device):
            box.currentIndexChanged.connect(self._update)
        self.iterations.valueChanged.connect(self._update)
        self.out.textChanged.connect(self._update)
        self._update()

    def job(self) -> TrainingJob:
        return TrainingJob(
            clip=self._clip.path,
            out=Path(self.out.text()),
            preset=self.preset.currentData(),
            routing=self.routing.currentData(),
            teacher=self.teacher.currentData(),
            iterations=self.iterations.value() or None,
            device=self.device.currentData(),
            seed=self.seed.value(),
            **self._answers,
        )

    def _update(self) -> None:
        from engine.training import TrainConfig, estimate

        job, problem = self.job(), ""
        try:
            config = TrainConfig.preset_of(job.preset, routing=job.routing, iterations=job.iterations, device=job.device, seed=job.seed)
            self.cost.setText(estimate(self._clip, config)["words"])
        except DegenseError as error:
            self.cost.setText("–")
            problem = str(error)
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


def _combo(entries: tuple[tuple[str, str], ...], chosen: str) -> QComboBox:
    box = QComboBox()
    for value, words in entries:
        box.addItem(words, value)
    box.setCurrentIndex([value for value, _ in entries].index(chosen))
    return box


def _free_folder(path: Path) -> Path:
    """`path`, or the first of path-2, path-3, … that does not exist."""
    candidate, number = path, 2
    while candidate.exists():
        candidate = path.with_name(f"{path.name}-{number}")
        number += 1
    return candidate
