"""Where a teacher finds its features or its model."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLineEdit, QPushButton, QWidget

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
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.line, 1)
        row.addWidget(self.choose)

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
