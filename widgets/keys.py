"""Who owns a plain key press: the focused control or the window's single-key shortcuts.

Qt asks the focused widget first, with a `ShortcutOverride` event; a widget that accepts it gets the key press and no shortcut fires.
Text fields accept printable keys by themselves, sliders and buttons accept nothing. Our controls keep the keys that they use with
`keep_keys`, so that the window may bind Space and arrows with ordinary shortcuts; for controls that are not ours it can ask
`consumes_key(QApplication.focusWidget())`.
"""

from __future__ import annotations

from collections.abc import Container

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QAbstractItemView, QAbstractSlider, QAbstractSpinBox, QComboBox, QLineEdit, QPlainTextEdit, QTextEdit, QWidget

_OWNERS = (QLineEdit, QTextEdit, QPlainTextEdit, QAbstractSpinBox, QComboBox, QAbstractSlider, QAbstractItemView)

_CHORD = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier | Qt.KeyboardModifier.MetaModifier

#: What sliders, lists and combo boxes step with.
ARROWS = frozenset(
    {
        Qt.Key.Key_Left,
        Qt.Key.Key_Right,
        Qt.Key.Key_Up,
        Qt.Key.Key_Down,
        Qt.Key.Key_Home,
        Qt.Key.Key_End,
        Qt.Key.Key_PageUp,
        Qt.Key.Key_PageDown,
    }
)

#: What buttons are pressed with.
PRESS = frozenset({Qt.Key.Key_Space, Qt.Key.Key_Return, Qt.Key.Key_Enter})


class _AllTyping(Container):
    """Every key but those that no text field uses: Escape and the function keys."""

    def __contains__(self, key: object) -> bool:
        return isinstance(key, int) and key != Qt.Key.Key_Escape and not Qt.Key.Key_F1 <= key <= Qt.Key.Key_F35


TYPING = _AllTyping()


def consumes_key(widget: QWidget | None) -> bool:
    """True when the focused widget types or steps with plain keys, so that a single-key shortcut must not fire."""
    return isinstance(widget, _OWNERS)


class _Keeper(QObject):
    """Accepts `ShortcutOverride` of the kept keys on behalf of the widget it watches."""

    def __init__(self, widget: QWidget, keys: Container[Qt.Key]) -> None:
        super().__init__(widget)
        self._keys = keys
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if not isinstance(event, QKeyEvent) or event.type() != QEvent.Type.ShortcutOverride:
            return False
        kept = not event.modifiers() & _CHORD and event.key() in self._keys
        if kept:
            event.accept()
        return kept


def keep_keys(widget: QWidget, keys: Container[Qt.Key]) -> None:
    """While `widget` has focus, `keys` without Ctrl, Alt or Meta reach it and no shortcut."""
    _Keeper(widget, keys)
