"""Keys that mean something else while one annotates: 1–9 choose classes, [ and ] the size, Tab goes to the next flagged frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QApplication

from degense.widgets.keys import consumes_key

if TYPE_CHECKING:
    from degense.app.features.annotate.controller import Annotator

DIGITS = range(Qt.Key.Key_1, Qt.Key.Key_9 + 1)
STEP = 2**0.25


class AnnotationKeys(QObject):
    """Takes these keys before the window's shortcuts do, unless something that types has the focus."""

    def __init__(self, annotating: Annotator) -> None:
        super().__init__(annotating)
        self.annotating = annotating
        self.panel = annotating.viewer.panel
        for watched in (annotating.shell, self.panel):
            watched.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() not in (QEvent.Type.ShortcutOverride, QEvent.Type.KeyPress) or not isinstance(event, QKeyEvent):
            return False
        if not self.annotating.part.active or event.modifiers() not in (Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.KeypadModifier):
            return False
        if consumes_key(QApplication.focusWidget()) or not self._means(event.key()):
            return False
        if event.type() == QEvent.Type.KeyPress:
            self._do(event.key())
        event.accept()
        return True

    def _means(self, key: int) -> bool:
        if key in (Qt.Key.Key_Return, Qt.Key.Key_Enter, Qt.Key.Key_Backspace, Qt.Key.Key_Escape):
            return self.annotating.polygons.corners > 0
        if key == Qt.Key.Key_Tab:
            return QApplication.focusWidget() is self.panel
        return key in DIGITS or key in (Qt.Key.Key_BracketLeft, Qt.Key.Key_BracketRight)

    def _do(self, key: int) -> None:
        annotating, part = self.annotating, self.annotating.part
        if key in DIGITS:
            part.choose(current=key - Qt.Key.Key_1)
        elif key == Qt.Key.Key_BracketLeft:
            part.choose(radius=part.radius / STEP)
        elif key == Qt.Key.Key_BracketRight:
            part.choose(radius=part.radius * STEP)
        elif key == Qt.Key.Key_Tab:
            annotating.go_to_flagged()
        elif key == Qt.Key.Key_Backspace:
            annotating.polygons.remove_last()
        elif key == Qt.Key.Key_Escape:
            annotating.polygons.cancel()
        else:
            annotating.polygons.close()
        self.panel.update()
