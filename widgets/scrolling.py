"""Areas that scroll what has too little room, and only then."""

from __future__ import annotations

from PySide6.QtWidgets import QFrame, QScrollArea, QVBoxLayout, QWidget


class _Least(QWidget):
    """As high as its content has to be at a width. By itself Qt takes what it would like to be, as soon as any text in it wraps."""

    def __init__(self, content: QWidget) -> None:
        super().__init__()
        self._content = content
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(content)

    def heightForWidth(self, width: int) -> int:
        inside = self._content.layout()
        return inside.totalMinimumHeightForWidth(width) if inside is not None else self._content.minimumSizeHint().height()


def scrolled(content: QWidget, name: str = "") -> QScrollArea:
    """A frameless area in which a widget is scrolled that has no room."""
    area = QScrollArea(widgetResizable=True)
    area.setAccessibleName(name)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setWidget(_Least(content))
    return area
