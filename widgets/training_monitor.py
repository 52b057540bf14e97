"""How training goes: stage, numbers, loss, preview, and a button that stops it."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QLabel, QProgressBar, QPushButton, QSplitter, QVBoxLayout, QWidget

from widgets.curve_plot import CurvePlot
from widgets.keys import PRESS, keep_keys
from widgets.render_panel import RenderPanel
from widgets.theme import error_colour

STATES = ("idle", "running", "finished", "failed", "cancelled")

_FACTS = ("Iteration", "Loss", "PSNR", "Gaussians", "Elapsed", "Time left")


def duration(seconds: float) -> str:
    """A time span in words one reads at a glance."""
    seconds = max(round(seconds), 0)
    if seconds < 60:
        return f"{seconds} s"
    minutes, seconds = divmod(seconds, 60)
    if minutes < 60:
        return f"{minutes} min {seconds:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


class TrainingMonitor(QWidget):
    """Shows what it is told. Cancel asks nothing and emits `cancel_requested`; the state changes when the end is reported."""

    cancel_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Training")
        self._state = "idle"
        self._heading = QLabel(self)
        font = self._heading.font()
        font.setBold(True)
        self._heading.setFont(font)
        self._heading.setTextFormat(Qt.TextFormat.PlainText)
        self._stage = QLabel(self)
        self._stage.setAccessibleName("State")
        self._stage.setTextFormat(Qt.TextFormat.PlainText)
        self._stage.setWordWrap(True)
        self._bar = QProgressBar(self)
        self._bar.setAccessibleName("Progress")
        self._bar.setTextVisible(True)
        self._cancel = QPushButton("Cancel", self)
        self._cancel.setToolTip("Stop training; what is learnt so far is kept as a checkpoint")
        self._cancel.clicked.connect(self._ask_to_stop)
        keep_keys(self._cancel, PRESS)
        self._facts: dict[str, QLabel] = {}
        facts = QGridLayout()
        facts.setHorizontalSpacing(10)
        facts.setVerticalSpacing(2)
        for i, name in enumerate(_FACTS):
            label, value = QLabel(name, self), QLabel("–", self)
            label.setObjectName("secondary")
            value.setAccessibleName(name)
            row, column = i // 3, 2 * (i % 3)
            facts.addWidget(label, row, column)
            facts.addWidget(value, row, column + 1)
            facts.setColumnStretch(column + 1, 1)
            self._facts[name] = value
        self._note = QLabel(self)
        self._note.setObjectName("secondary")
        self._note.setTextFormat(Qt.TextFormat.PlainText)
        self._note.setWordWrap(True)
        self._note.hide()
        self._plot = CurvePlot(self)
        self._plot.setAccessibleName("Loss")
        self._plot.set_labels("iteration", "")
        self._plot.set_log_y(True)
        self._plot.set_message("The loss curve appears here")
        self._preview = RenderPanel(self)
        self._preview.setAccessibleName("Preview")
        self._preview.set_message("A preview appears here during training")
        split = QSplitter(Qt.Orientation.Horizontal, self)
        split.setChildrenCollapsible(False)
        split.addWidget(self._plot)
        split.addWidget(self._preview)
        split.setSizes([300, 260])

        top = QHBoxLayout()
        top.addWidget(self._heading, 1)
        top.addWidget(self._cancel)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 8, 8, 8)
        layout.setSpacing(6)
        layout.addLayout(top)
        layout.addWidget(self._stage)
        layout.addWidget(self._bar)
        layout.addLayout(facts)
        layout.addWidget(self._note)
        layout.addWidget(split, 1)
        self.reset()

    def state(self) -> str:
        return self._state

    def reset(self) -> None:
        """As if nothing had been trained."""
        self._clear()
        self._enter("idle", "No training is running")
        self._heading.setText("Training")

    def start(self, title: str = "") -> None:
        """A run begins: empty curves, unknown progress."""
        self._clear()
        self._heading.setText(title or "Training")
        self._bar.setRange(0, 0)
        self._enter("running", "Starting…")

    def set_stage(self, text: str) -> None:
        self._stage.setText(text)

    def set_progress(
        self,
        iteration: int,
        iterations: int,
        loss: float | None = None,
        psnr: float | None = None,
        gaussians: int | None = None,
        seconds: float | None = None,
        eta: float | None = None,
    ) -> None:
        """Numbers as they come; None leaves what is shown. PSNR in dB, times in seconds."""
        self._bar.setRange(0, max(iterations, 1))
        self._bar.setValue(iteration)
        texts = {
            "Iteration": f"{iteration:,} / {iterations:,}",
            "Loss": None if loss is None else f"{loss:.4g}",
            "PSNR": None if psnr is None else f"{psnr:.2f} dB",
            "Gaussians": None if gaussians is None else f"{gaussians:,}",
            "Elapsed": None if seconds is None else duration(seconds),
            "Time left": None if eta is None else duration(eta),
        }
        for name, text in texts.items():
            if text is not None:
                self._facts[name].setText(text)
        if loss is not None:
            self._plot.append("loss", iteration, loss)

    def set_preview(self, rgb: np.ndarray | None) -> None:
        self._preview.set_image(rgb)

    def note(self, text: str) -> None:
        """A remark that stays until the next, such as a rollback; empty takes it away."""
        self._note.setText(text)
        self._note.setVisible(bool(text))

    def finish(self, message: str) -> None:
        self._bar.setRange(0, 1)
        self._bar.setValue(1)
        self._facts["Time left"].setText("–")
        self._enter("finished", message)

    def fail(self, message: str) -> None:
        self._stop_bar()
        self._enter("failed", message)

    def cancelled(self, message: str = "") -> None:
        self._stop_bar()
        self._enter("cancelled", message or "Stopped")

    def _enter(self, state: str, message: str) -> None:
        self._state = state
        self._stage.setText(f"⚠ {message}" if state == "failed" else message)
        colours = self.palette()
        if state == "failed":
            colours.setColor(colours.ColorRole.WindowText, error_colour(colours))
        self._stage.setPalette(colours)
        self._cancel.setText("Cancel")
        self._cancel.setEnabled(state == "running")

    def _clear(self) -> None:
        self._bar.setRange(0, 1)
        self._bar.reset()
        self._plot.clear()
        self._preview.set_image(None)
        self.note("")
        for value in self._facts.values():
            value.setText("–")

    def _stop_bar(self) -> None:
        if self._bar.maximum() == 0:
            self._bar.setRange(0, 1)
            self._bar.reset()
        self._facts["Time left"].setText("–")

    def _ask_to_stop(self) -> None:
        self._cancel.setEnabled(False)
        self._cancel.setText("Stopping…")
        self.cancel_requested.emit()
