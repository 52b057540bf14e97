"""What was detected in the clip or recorded in the run."""

from __future__ import annotations

from html import escape

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QLabel, QPushButton, QScrollArea, QWidget

from degense.widgets import forms


class Facts(QScrollArea):
    """Lines of text; for a clip without a run also the ways to checking it and to training."""

    check_requested = Signal()
    train_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, widgetResizable=True)
        self.setAccessibleName("Clip and run")
        self.setFrameShape(QFrame.Shape.NoFrame)
        inside, self.next_steps = QWidget(), QWidget()
        self.text = QLabel("Nothing is open.", wordWrap=True, textFormat=Qt.TextFormat.RichText)
        self.text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.check, train = QPushButton("Check on frames…"), QPushButton("Train…")
        self.check.clicked.connect(self.check_requested)
        train.clicked.connect(self.train_requested)
        forms.row(self.check, train, parent=self.next_steps)
        forms.column(self.next_steps, self.text, 0, margin=9, parent=inside)  # what to do next is seen without scrolling
        self.setWidget(inside)
        self.next_steps.hide()

    def show_facts(self, rows: list[tuple[str, str]], is_clip: bool) -> None:
        """Show label and text of each fact; `is_clip` for a clip that can be checked and trained on."""
        cells = "".join(
            f"<tr><td style='padding: 0 8px 4px 0'><b>{escape(key, quote=False)}</b></td><td>{escape(text, quote=False)}</td></tr>"
            for key, text in rows
        )
        self.text.setText(f"<table>{cells}</table>")
        self.next_steps.setVisible(is_clip)
