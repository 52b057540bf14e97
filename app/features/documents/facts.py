"""What was detected in the clip or recorded in the run."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QScrollArea, QVBoxLayout, QWidget


class Facts(QScrollArea):
    """Lines of text; for a clip without a run also the ways to checking it and to training.

    Signals
    -------
    check_requested(), train_requested()
    """

    check_requested = Signal()
    train_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Clip and run")
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        inside = QWidget()
        column = QVBoxLayout(inside)
        self.text = QLabel("Nothing is open.")
        self.text.setWordWrap(True)
        self.text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.text.setTextFormat(Qt.TextFormat.RichText)
        column.addWidget(self.text)
        self.next_steps = QWidget()
        row = QHBoxLayout(self.next_steps)
        row.setContentsMargins(0, 0, 0, 0)
        self.check, train = QPushButton("Check on frames…"), QPushButton("Train…")
        self.check.clicked.connect(self.check_requested)
        train.clicked.connect(self.train_requested)
        row.addWidget(self.check)
        row.addWidget(train)
        column.addWidget(self.next_steps)
        column.addStretch(1)
        self.setWidget(inside)
        self.next_steps.hide()

    def show_facts(self, rows: list[tuple[str, str]], is_clip: bool) -> None:
        """Show label and text of each fact; `is_clip` for a clip that can be checked and trained on."""
        cells = "".join(
            f"<tr><td style='padding: 0 8px 4px 0'><b>{_escape(key)}</b></td><td>{_escape(text)}</td></tr>" for key, text in rows
        )
        self.text.setText(f"<table>{cells}</table>")
        self.next_steps.setVisible(is_clip)


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
