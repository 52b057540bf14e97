"""Keys that mean something else while one annotates: 1–9 choose classes, [ and ] the size, Tab goes to the next flagged frame."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QApplication

from degense.app.features.annotate.painter import Painter
from degense.app.features.annotate.review import PropagationReview
from degense.app.features.annotate.state import AnnotationState
from degense.app.shell.shell import Shell
from degense.widgets.keys import consumes_key

DIGITS = range(Qt.Key.Key_1, Qt.Key.Key_9 + 1)
STEP = 2**0.25


class AnnotationKeys(QObject):
    """Takes these keys before the window's shortcuts do, unless something that types has the focus."""

    def __init__(self, shell: Shell, state: AnnotationState, painter: Painter, review: PropagationReview) -> None:
        super().__init__(shell)
        self.state, self.panel = state, painter.panel
        self._polygon_keys: dict[int, Callable[[], object]] = {
            Qt.Key.Key_Return: painter.polygons.close,
            Qt.Key.Key_Enter: painter.polygons.close,
            Qt.Key.Key_Backspace: painter.polygons.remove_last,
            Qt.Key.Key_Escape: painter.polygons.cancel,
        }
        self._keys: dict[int, Callable[[], object]] = {
            Qt.Key.Key_Tab: review.go_to_flagged,
            Qt.Key.Key_BracketLeft: lambda: state.tool.choose(radius=state.tool.radius / STEP),
            Qt.Key.Key_BracketRight: lambda: state.tool.choose(radius=state.tool.radius * STEP),
            **{key: partial(state.choose_class, key - Qt.Key.Key_1) for key in DIGITS},
        }
        self._polygons = painter.polygons
        for watched in (shell, self.panel):
            watched.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() not in (QEvent.Type.ShortcutOverride, QEvent.Type.KeyPress) or not isinstance(event, QKeyEvent):
            return False
        if not self.state.tool.active or event.modifiers() not in (Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.KeypadModifier):
            return False
        focus, key = QApplication.focusWidget(), event.key()
        act = self._polygon_keys.get(key) if self._polygons.corners > 0 else None
        act = act or self._keys.get(key)
        if act is None or consumes_key(focus) or (key == Qt.Key.Key_Tab and focus is not self.panel):
            return False
        if event.type() == QEvent.Type.KeyPress:
            act()
            self.panel.update()
        event.accept()
        return True
