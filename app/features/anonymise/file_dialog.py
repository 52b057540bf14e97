"""A dialog that asks where one file is written, and whether it is anonymised."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtWidgets import QDialogButtonBox, QFormLayout, QPushButton

from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.anonymise.box import AnonymiseBox
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.widgets import forms


class FileDialog(forms.Dialog):
    """`write` writes the file, and raises a DegenseError that is shown here.

    Shown are `title`, a `hint` of what is written and `verb` on the button; `proposal` is the file at first, `nameless` its name where it
    is anonymised, and `kinds` are as Qt's filters. `name` is the dialog's object name.
    """

    def __init__(
        self,
        shell: Shell,
        name: str,
        title: str,
        verb: str,
        hint: str,
        kinds: str,
        proposal: Path,
        nameless: str,
        write: Callable[[Path, Anonymity], None],
    ) -> None:
        super().__init__(shell, name, title, 620, 220)
        self._shell, self._write, self._kinds = shell, write, kinds
        self._proposals = [str(proposal), str(proposal.with_name(nameless))]
        self.path = forms.PathLine("Where it is written", self._browse)
        self.anonymise = AnonymiseBox(shell)
        self.complaint = forms.complaint()
        buttons = self.closing()
        self.start = QPushButton(verb)
        self.start.setDefault(True)
        self.start.clicked.connect(self._start)
        buttons.addButton(self.start, QDialogButtonBox.ButtonRole.ActionRole)
        form = QFormLayout()
        form.addRow("Where", self.path)
        form.addRow("Anonymise", self.anonymise)
        forms.column(forms.label(hint, secondary=True), form, self.complaint, 0, buttons, margin=12, parent=self)
        self._propose()
        self.anonymise.changed.connect(self._propose)
        for changed in (self.anonymise.changed, self.path.line.textChanged):
            changed.connect(lambda *value: self.complaint.clear())

    def _propose(self) -> None:
        """A name of a file without that of the run, where this is anonymised; what was typed stays."""
        if self.path.line.text() in ("", *self._proposals):
            self.path.line.setText(self._proposals[self.anonymise.value().on])

    def _browse(self, start: str) -> str:
        return str(self._shell.ask_save(self.windowTitle(), start, self._kinds) or "")

    def _start(self) -> None:
        try:
            self._write(Path(self.path.line.text().strip()).expanduser(), self.anonymise.value())
        except DegenseError as error:
            self.complaint.setText(str(error))
        else:
            self.accept()
