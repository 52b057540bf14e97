"""What was detected in the clip or recorded in the run, and the answers a user may correct."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QComboBox, QDoubleSpinBox, QFormLayout, QFrame, QLabel, QPushButton, QScrollArea, QVBoxLayout, QWidget

MEANINGS = (("as detected", None), ("white = instrument, left out", "tool"), ("white = tissue, kept", "keep"))


class Facts(QScrollArea):
    """Lines of text; for a clip without a run also what white means in its masks, its focal length, and the way to training.

    Signals
    -------
    corrected(mask_means or None, focal or None)
        Open the clip again with these answers.
    train_requested()
    """

    corrected = Signal(object, object)
    train_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        inside = QWidget()
        column = QVBoxLayout(inside)
        self.text = QLabel("Nothing is open.")
        self.text.setWordWrap(True)
        self.text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.text.setTextFormat(Qt.TextFormat.RichText)
        column.addWidget(self.text)
        self.corrections = QWidget()
        form = QFormLayout(self.corrections)
        form.setContentsMargins(0, 0, 0, 0)
        self.meaning = QComboBox()
        for title, value in MEANINGS:
            self.meaning.addItem(title, value)
        self.focal = QDoubleSpinBox()
        self.focal.setRange(0, 100_000)
        self.focal.setDecimals(1)
        self.focal.setSuffix(" px")
        self.focal.setSpecialValueText("as detected")
        apply = QPushButton("Apply")
        apply.clicked.connect(self._apply)
        train = QPushButton("Train…")
        train.clicked.connect(self.train_requested)
        form.addRow("Masks", self.meaning)
        form.addRow("Focal length", self.focal)
        form.addRow(apply)
        form.addRow(train)
        column.addWidget(self.corrections)
        column.addStretch(1)
        self.setWidget(inside)
        self.corrections.hide()

    def show_facts(self, rows: list[tuple[str, str]], correctable: bool) -> None:
        """Show label and text of each fact; `correctable` for a clip that can be opened again with other answers."""
        cells = "".join(
            f"<tr><td style='padding: 0 8px 4px 0'><b>{_escape(key)}</b></td><td>{_escape(text)}</td></tr>" for key, text in rows
        )
        self.text.setText(f"<table>{cells}</table>")
        self.corrections.setVisible(correctable)

    def set_corrections(self, mask_means: str | None, focal: float | None) -> None:
        """Show the answers the clip was opened with."""
        self.meaning.setCurrentIndex([value for _, value in MEANINGS].index(mask_means))
        self.focal.setValue(focal or 0.0)

    def _apply(self) -> None:
        self.corrected.emit(self.meaning.currentData(), self.focal.value() or None)


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
