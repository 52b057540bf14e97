"""File ▸ Export ▸ Report: where to, as what, and whether it is anonymised."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtWidgets import QDialogButtonBox, QFormLayout, QPushButton

from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.anonymise.box import AnonymiseBox
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.widgets import forms

KINDS = "Web page (*.html);;PDF (*.pdf)"


class ReportDialog(forms.Dialog):
    """Asks for a file; `export` writes it, and raises a DegenseError that is shown here."""

    def __init__(self, shell: Shell, proposal: Path, export: Callable[[Path, Anonymity], None]) -> None:
        super().__init__(shell, "report", "Report", 620, 220)
        self._shell, self._export, self._folder, self._name = shell, export, proposal.parent, proposal.name
        self.path = forms.PathLine("Where it is written", self._browse)
        self.anonymise = AnonymiseBox(shell)
        self.complaint = forms.complaint()
        buttons = self.closing()
        self.start = QPushButton("Export")
        self.start.setDefault(True)
        self.start.clicked.connect(self._start)
        buttons.addButton(self.start, QDialogButtonBox.ButtonRole.ActionRole)
        form = QFormLayout()
        form.addRow("Where", self.path)
        form.addRow("Anonymise", self.anonymise)
        hint = forms.label("A web page (.html) or a PDF (.pdf) with pictures, events, measures and where they come from.", secondary=True)
        forms.column(hint, form, self.complaint, 0, buttons, margin=12, parent=self)
        self._propose()
        self.anonymise.changed.connect(self._propose)
        self.path.line.textChanged.connect(lambda text: self.complaint.clear())

    def _propose(self) -> None:
        """A name of a file without that of the run, where this is anonymised; what was typed stays."""
        proposals = [str(self._folder / name) for name in (self._name, "report.html")]
        if self.path.line.text() in ("", *proposals):
            self.path.line.setText(proposals[self.anonymise.value().on])

    def _browse(self, start: str) -> str:
        return str(self._shell.ask_save("Export a report", start, KINDS) or "")

    def _start(self) -> None:
        try:
            self._export(Path(self.path.line.text().strip()).expanduser(), self.anonymise.value())
        except DegenseError as error:
            self.complaint.setText(str(error))
        else:
            self.accept()
