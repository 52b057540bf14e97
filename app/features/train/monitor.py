"""Progress of a training: stage, numbers, curves, a preview compared with the recorded frame, and buttons that pause and stop it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QComboBox, QGridLayout, QListWidget, QProgressBar, QSplitter, QWidget

from degense.engine.events import TrainingProgress
from degense.widgets import forms
from degense.widgets.curve_plot import CurvePlot
from degense.widgets.frame.render_panel import RenderPanel
from degense.widgets.keys import ARROWS, keep_keys
from degense.widgets.theme import error_colour

COMPARES = (("wipe", "Wipe: model | recorded"), ("off", "Model"), ("blink", "Blink"), ("difference", "Difference"))

_FACTS = ("Iteration", "Loss", "PSNR", "Gaussians", "Elapsed", "Time left")
TOTAL = "loss"  # the sum of all terms of the loss, which is plotted at first


def duration(seconds: float) -> str:
    """A time span as text, such as "4 min 20 s"."""
    seconds = max(round(seconds), 0)
    if seconds < 60:
        return f"{seconds} s"
    minutes, seconds = divmod(seconds, 60)
    if minutes < 60:
        return f"{minutes} min {seconds:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


class RunQueue(QWidget):
    """The trainings that wait, the next one first. It asks for changes and shows what it is given."""

    removed = Signal(int)  # (row) take a training out of the queue
    raised = Signal(int)  # (row) let it come earlier

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Waiting trainings")
        self.list = QListWidget()
        self.list.setAccessibleName("Waiting trainings, the next one first")
        self.list.currentRowChanged.connect(lambda row: self._enable())
        keep_keys(self.list, ARROWS)
        self.earlier = forms.button("Earlier", lambda: self.raised.emit(self.list.currentRow()), "Start it before the one above")
        self.remove = forms.button("Remove", lambda: self.removed.emit(self.list.currentRow()), "Take it out of the queue")
        buttons = forms.row(self.earlier, self.remove)
        forms.column(forms.label("Waiting", secondary=True), (self.list, 1), buttons, margin=0, spacing=4, parent=self)
        self.set_runs(())

    def set_runs(self, names: Sequence[str]) -> None:
        """Show these, and nothing at all when there are none."""
        row = self.list.currentRow()
        self.list.clear()
        self.list.addItems(list(names))
        self.list.setCurrentRow(min(max(0, row), len(names) - 1))
        self.setVisible(bool(names))
        self._enable()

    def _enable(self) -> None:
        row = self.list.currentRow()
        self.remove.setEnabled(row >= 0)
        self.earlier.setEnabled(row > 0)


class TrainingMonitor(QWidget):
    """Shows the progress it is given. The buttons only emit requests; the state changes when the end is reported."""

    cancel_requested = Signal()
    pause_requested = Signal()
    chosen = Signal(int)  # (row of `set_running`) another training is to be shown
    resume_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Training")
        self.state = "idle"
        self._history: list[TrainingProgress] = []
        self._heading = forms.label(wrap=False)
        font = self._heading.font()
        font.setBold(True)
        self._heading.setFont(font)
        self._stage = forms.label("–", name="State")
        self.running = forms.choice("Training that is shown", [])
        self.running.activated.connect(self.chosen.emit)
        self._bar = QProgressBar(textVisible=True)
        self._bar.setAccessibleName("Progress")
        self._cancel = forms.button("Cancel", self._ask_to_stop, "Stop training; the state so far is saved as a checkpoint")
        self._pause = forms.button("Pause", self._ask_to_pause)
        self._facts = {name: forms.label("–", name=name, wrap=False) for name in _FACTS}
        self._note = forms.label(secondary=True)
        self._note.hide()
        self._plot = _curve_plot("Loss", "loss", "The loss curve appears here", log=True)
        self._term = forms.choice("Term of the loss that is plotted", [(None, TOTAL)])
        self._term.currentIndexChanged.connect(self._plot_term)
        self._scores = _curve_plot("PSNR", "PSNR [dB]", "The PSNR of the training frames appears here")
        self._preview = RenderPanel()
        self._preview.setAccessibleName("Preview")
        self._preview.set_message("A preview appears here during training")
        self._compare = forms.choice("Compare the preview with the recorded frame", COMPARES)
        self._compare.currentIndexChanged.connect(lambda: self._preview.comparison.set_mode(self._compare.currentData()))
        self._preview.comparison.set_mode("wipe")
        self.queue = RunQueue()
        self._arrange()
        self.reset()

    def _arrange(self) -> None:
        """Heading, buttons, state, bar and numbers at the left; curves, preview and queue beside them."""
        facts = QGridLayout()
        facts.setHorizontalSpacing(10)
        facts.setVerticalSpacing(2)
        for i, (name, value) in enumerate(self._facts.items()):
            row, column = i // 2, 2 * (i % 2)
            facts.addWidget(forms.label(name, secondary=True, wrap=False), row, column)
            facts.addWidget(value, row, column + 1)
            facts.setColumnStretch(column + 1, 1)
        split = QSplitter(Qt.Orientation.Horizontal, childrenCollapsible=False)
        for part in (_stacked(self._plot, self._term), self._scores, _stacked(self._preview, self._compare), self.queue):
            split.addWidget(part)
        split.setSizes([300, 300, 300, 160])
        bar = forms.row((self._bar, 1), self._pause, self._cancel)
        side = forms.column(self.running, self._heading, self._stage, bar, facts, self._note, 0, margin=0)
        forms.row((side, 1), (split, 3), spacing=10, parent=self).setContentsMargins(8, 0, 8, 6)

    def reset(self) -> None:
        """As if nothing had been trained."""
        self._clear()
        self._enter("idle", "No training is running")
        self.set_running((), -1)
        self._heading.hide()

    def start(self, title: str = "") -> None:
        """A run begins: empty curves, unknown progress."""
        self._clear()
        self._heading.setText(title)
        self._heading.setVisible(bool(title))
        self._bar.setRange(0, 0)
        self._enter("running", "Starting…")

    def set_running(self, names: Sequence[str], row: int) -> None:
        """The trainings that run, of which this one is shown; a menu of them where there are several."""
        self.running.clear()
        self.running.addItems(list(names))
        self.running.setCurrentIndex(row)
        self.running.setVisible(len(names) > 1)

    def set_stage(self, text: str) -> None:
        self._stage.setText(text)

    def set_progress(self, *reports: TrainingProgress) -> None:
        """Numbers as they come; None leaves what is shown. Steps that are made again replace the earlier ones."""
        for now in reports:
            while self._history and self._history[-1].iteration >= now.iteration:
                self._history.pop()
            self._history.append(now)
            self._show(now)
        self._plot_term()
        known = [past for past in self._history if past.psnr is not None]
        if known:
            self._scores.set_series("PSNR", *np.array([(past.iteration, past.psnr) for past in known]).T)

    def _show(self, now: TrainingProgress) -> None:
        self._bar.setRange(0, max(now.iterations, 1))
        self._bar.setValue(now.iteration)
        texts = {
            "Iteration": f"{now.iteration:,} / {now.iterations:,}",
            "Loss": None if now.loss is None else f"{now.loss:.4g}",
            "PSNR": None if now.psnr is None else f"{now.psnr:.2f} dB",
            "Gaussians": None if now.gaussians is None else f"{now.gaussians:,}",
            "Elapsed": None if now.seconds is None else duration(now.seconds),
            "Time left": None if now.eta is None else duration(now.eta),
        }
        for name, text in texts.items():
            if text is not None:
                self._facts[name].setText(text)
        for name in now.losses:
            if self._term.findText(name) < 0:
                self._term.addItem(name)

    def _plot_term(self) -> None:
        """Plot the chosen term from the beginning."""
        term = self._term.currentText()
        values = [(past.iteration, past.loss if term == TOTAL else past.losses.get(term)) for past in self._history]
        known = [point for point in values if point[1] is not None]
        if list(self._plot.series) != [term]:
            self._plot.clear()
            self._plot.set_labels("iteration", term)
        if known:
            self._plot.set_series(term, *np.array(known, float).T)

    def set_preview(self, rgb: np.ndarray | None, observed: np.ndarray | None = None) -> None:
        """Show a frame as the model draws it, uint8 [H, W, 3], and as it was recorded."""
        self._preview.set_image(rgb)
        if observed is not None:
            self._preview.comparison.set_observed(observed)

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
        self._enter("failed", message)

    def pause(self, message: str) -> None:
        """It has made room and can go on."""
        self._enter("paused", message)

    def cancelled(self, message: str = "Stopped") -> None:
        self._enter("cancelled", message)

    def _enter(self, state: str, message: str) -> None:
        self.state = state
        if state in ("failed", "paused", "cancelled"):
            self._facts["Time left"].setText("–")
            if self._bar.maximum() == 0:
                self._bar.setRange(0, 1)
                self._bar.reset()
        self._stage.setText(f"⚠ {message}" if state == "failed" else message)
        colours = self.palette()
        if state == "failed":
            colours.setColor(colours.ColorRole.WindowText, error_colour(colours))
        self._stage.setPalette(colours)
        self._cancel.setText("Cancel")
        self._cancel.setEnabled(state in ("running", "paused"))
        self._pause.setText("Resume" if state == "paused" else "Pause")
        self._pause.setToolTip("Go on where it was paused" if state == "paused" else "Save and make room; it resumes exactly where it was")
        self._pause.setEnabled(state in ("running", "paused"))

    def _clear(self) -> None:
        self._bar.setRange(0, 1)
        self._bar.reset()
        self._history.clear()
        self._plot.clear()
        self._scores.clear()
        self._preview.set_image(None)
        self._preview.comparison.set_observed(None)
        self.note("")
        for value in self._facts.values():
            value.setText("–")

    def _ask_to_stop(self) -> None:
        self._cancel.setEnabled(False)
        self._pause.setEnabled(False)
        self._cancel.setText("Stopping…")
        self.cancel_requested.emit()

    def _ask_to_pause(self) -> None:
        self._pause.setEnabled(False)
        if self.state == "paused":
            self.resume_requested.emit()
        else:
            self._pause.setText("Pausing…")
            self.pause_requested.emit()


def _curve_plot(name: str, unit: str, message: str, log: bool = False) -> CurvePlot:
    """An empty plot over iterations."""
    plot = CurvePlot(log=log)
    plot.setAccessibleName(name)
    plot.set_labels("iteration", unit)
    plot.set_message(message)
    return plot


def _stacked(view: QWidget, box: QComboBox) -> QWidget:
    """A view with the menu that belongs to it below."""
    both = QWidget()
    forms.column((view, 1), box, margin=0, spacing=4, parent=both)
    return both
