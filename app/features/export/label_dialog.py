"""File ▸ Export ▸ Masks and annotations: what, in which format, which frames, where to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QDialogButtonBox, QFormLayout, QProgressBar, QPushButton, QWidget

from degense.app.features.annotate.label_sets import at_frames, label_format, write_labels
from degense.app.features.anonymise.box import AnonymiseBox
from degense.app.features.export.label_offers import LabelOffer, LabelPlan
from degense.app.session.sample import is_demo
from degense.app.shell.shell import Shell
from degense.engine.annotation.formats import LABEL_FORMATS, LabelFormat
from degense.engine.errors import DegenseError
from degense.widgets import forms

if TYPE_CHECKING:
    from degense.engine.progress import Steps

FRAMES = (("this", "this frame"), ("range", "a range of frames"), ("labelled", "frames with annotations"), ("all", "all frames"))


class LabelExportDialog(forms.Dialog):
    """Says what will be written before it is, then shows how far it is; closing it stops the export."""

    def __init__(self, shell: Shell, offers: Mapping[str, LabelOffer], annotated: tuple[int, ...], source: str) -> None:
        super().__init__(shell, "export-labels", "Export masks or annotations", 640, 330)
        self._shell, self._offers, self._annotated, self._running = shell, offers, annotated, False
        session = shell.session
        opened = session.scene.run.path if session.scene is not None else session.clip.path if session.clip is not None else Path.home()
        self._folder = Path.home() if is_demo(opened) else opened.parent
        self.source = forms.choice("What is exported", ((name, offer.title) for name, offer in offers.items()))
        self.format = forms.choice("Format", ((name, kind.title) for name, kind in LABEL_FORMATS.items()))
        self.frames = forms.choice("Frames", FRAMES)
        self.first = forms.number("First frame", 0, session.frames - 1)
        self.last = forms.number("Last frame", 0, session.frames - 1)
        self.last.setValue(session.frames - 1)
        self.path = forms.PathLine("Where it is written", self._browse)
        self.anonymise = AnonymiseBox(shell)
        self.sentence, self.complaint = forms.label(name="What will be written"), forms.complaint()
        self.bar = forms.named(QProgressBar(textVisible=False), "How far the export is")
        self.bar.hide()
        buttons = self.closing()
        self.start = QPushButton("Export")
        self.start.setDefault(True)
        buttons.addButton(self.start, QDialogButtonBox.ButtonRole.ActionRole)
        self.start.clicked.connect(self._export)
        self._form = QWidget()
        self._rows = form = QFormLayout(self._form)
        form.setContentsMargins(0, 0, 0, 0)
        self._range = QWidget()
        forms.row(self.first, forms.label("to", wrap=False), self.last, 0, parent=self._range)
        rows = (("What", self.source), ("Format", self.format), ("Frames", self.frames), ("From", self._range), ("Where", self.path))
        for words, control in (*rows, ("Anonymise", self.anonymise)):
            form.addRow(words, control)
        forms.column(self._form, self.sentence, self.complaint, 0, self.bar, buttons, margin=12, parent=self)
        forms.enter(self.source, source)
        forms.enter(self.frames, "labelled" if source == "annotations" else "all")
        self._propose()
        self.format.currentIndexChanged.connect(self._propose)
        self.anonymise.check.toggled.connect(self._propose)
        for changed in (*map(forms.changed, (self.source, self.frames, self.first, self.last)), self.path.line.textChanged):
            changed.connect(self._show)
        self._show()

    @property
    def plan(self) -> LabelPlan:
        """What is chosen."""
        which, here, count = forms.value(self.frames), self._shell.session.frame, self._shell.session.frames
        chosen = {"this": (here,), "labelled": self._annotated, "all": tuple(range(count))}
        frames = chosen.get(which, tuple(range(self.first.value(), self.last.value() + 1)))
        text = self.path.line.text().strip()
        return LabelPlan(self._offers[forms.value(self.source)], self._kind, frames, Path(text).expanduser() if text else None)

    @property
    def _kind(self) -> LabelFormat:
        return label_format(forms.value(self.format))

    def _propose(self) -> None:
        """A name of its own for each format, in the folder that was chosen last."""
        name = self.anonymise.value().name(self._shell.session.name)
        self.path.line.setText(str(self._folder / f"{name}-{forms.value(self.format)}{self._kind.suffix}"))

    def _browse(self, start: str) -> str:
        suffix = self._kind.suffix
        path = self._shell.ask_save("Export to", start, f"*{suffix}" if suffix else "")
        if path is not None:
            self._folder = path.parent
        return str(path or "")

    def _show(self) -> None:
        plan = self.plan
        self._rows.setRowVisible(self._range, forms.value(self.frames) == "range")
        self.sentence.setText("" if plan.problem else plan.sentence)
        self.complaint.setText(plan.problem)
        self.start.setEnabled(not plan.problem and not self._running)

    def _export(self) -> None:
        plan, name = self.plan, forms.value(self.format)
        assert plan.out is not None
        out = plan.out
        try:
            maps = at_frames(plan.offer.maps(self.anonymise.value()), plan.frames)
        except DegenseError as error:
            self.complaint.setText(str(error))
            return

        def job() -> Steps[str]:
            return write_labels(name, maps, out)

        self._set_running(True)
        self._shell.submit("export", job, self._done, self._failed, lambda step: self.bar.setValue(round(100 * step[0])))

    def _done(self, words: str) -> None:
        self._running = False
        self._shell.say(f"Saved {words}")
        self.accept()

    def _failed(self, message: str) -> None:
        self._set_running(False)
        self.complaint.setText(message)

    def _set_running(self, running: bool) -> None:
        self._running = running
        self._form.setEnabled(not running)
        self.bar.setVisible(running)
        self.bar.setValue(0)
        self.start.setText("Exporting…" if running else "Export")
        self._show()
        self._shell.refresh()

    def done(self, result: int) -> None:
        if self._running:
            self._shell.worker.cancel("export")
            self._shell.say("Export stopped; nothing was written.")
            self._shell.refresh()
        super().done(result)
