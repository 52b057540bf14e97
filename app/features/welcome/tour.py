"""Five steps through the window: a frame around what is meant, and a few words beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, QPoint, QRect, Qt, QTimer, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QDockWidget, QFrame, QWidget

from degense.widgets import forms

GAP, WIDTH = 12, 46  # pixels around what is framed; width of the words in widths of a character


@dataclass(frozen=True)
class Stop:
    """A step of the tour."""

    title: str
    words: str
    where: Callable[[], QWidget | None]  # what it is about; None for the middle of the window


class Tour(QFrame):
    """Next, Back and Skip, which is Escape too. It lies over the window, which goes on meanwhile."""

    ended = Signal()

    def __init__(self, window: QWidget, stops: tuple[Stop, ...]) -> None:
        super().__init__(window)
        self.setObjectName("tour")
        self.setAccessibleName("Tour")
        self._window, self._stops, self._at = window, stops, 0
        self._frame = QFrame(window)
        self._frame.setObjectName("tourFrame")
        self._frame.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._title, self._words, self._count = forms.label(wrap=False), forms.label(), forms.label(secondary=True, wrap=False)
        font = self._title.font()
        font.setBold(True)
        self._title.setFont(font)
        self._words.setFixedWidth(WIDTH * self.fontMetrics().averageCharWidth())
        self.skip = forms.button("Skip", self.end, "Close the tour (Esc); Help ▸ Tour shows it again")
        self.back, self.next = forms.button("Back", lambda: self.go(-1)), forms.button("Next", lambda: self.go(1))
        buttons = forms.row(self._count, 0, self.skip, self.back, self.next)
        forms.column(self._title, self._words, 4, buttons, margin=14, spacing=8, parent=self)
        window.installEventFilter(self)
        self._show()

    def go(self, step: int) -> None:
        """To another stop; beyond the last one it ends."""
        if self._at + step >= len(self._stops):
            self.end()
            return
        self._at = max(0, self._at + step)
        self._show()

    def end(self) -> None:
        self._frame.deleteLater()
        self._frame.hide()
        self.hide()
        self._window.removeEventFilter(self)
        self.deleteLater()
        self.ended.emit()

    def _show(self) -> None:
        stop = self._stops[self._at]
        self._title.setText(stop.title)
        self._words.setText(stop.words)
        self._words.setMinimumHeight(self._words.heightForWidth(self._words.width()))
        self._count.setText(f"{self._at + 1} of {len(self._stops)}")
        self.setAccessibleDescription(f"{stop.title}. {stop.words}")
        if isinstance(panel := stop.where(), QDockWidget):
            panel.raise_()  # from behind its neighbours in tabs
            QTimer.singleShot(0, self, self._place)
        self.back.setEnabled(self._at > 0)
        self.next.setText("Done" if self._at == len(self._stops) - 1 else "Next")
        self._place()
        self.show()
        self.raise_()
        self.next.setFocus()

    def _place(self) -> None:
        """Frame what the stop is about, and lie where there is room beside it."""
        self.adjustSize()
        room, target = self._window.rect(), self._stops[self._at].where()
        shown = target is not None and target.isVisible()
        area = QRect(room.center(), room.center())
        if target is not None and shown:
            area = QRect(target.mapTo(self._window, QPoint(0, 0)), target.size())
        self._frame.setGeometry(area.adjusted(1, 1, -1, -1))
        self._frame.setVisible(shown)
        self._frame.raise_()
        self.raise_()
        mine, middle = self.rect(), area.center()
        places = (
            QPoint(area.left() - mine.width() - GAP, middle.y() - mine.height() // 2),
            QPoint(middle.x() - mine.width() // 2, area.top() - mine.height() - GAP),
            QPoint(middle.x() - mine.width() // 2, area.bottom() + GAP),
            middle - mine.center(),
        )
        fits = [place for place in places if room.contains(QRect(place, mine.size()))]
        place = fits[0] if fits else places[-1]
        self.move(
            min(max(GAP, place.x()), max(GAP, room.width() - mine.width() - GAP)),
            min(max(GAP, place.y()), max(GAP, room.height() - mine.height() - GAP)),
        )

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key.Key_Escape:
            self.end()
        else:
            super().keyPressEvent(event)

    def event(self, event: QEvent) -> bool:
        """Escape is the tour's own while it has the focus, and no shortcut of the window."""
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_Escape:
            event.accept()
            return True
        return super().event(event)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            self._place()
        elif event.type() == QEvent.Type.LayoutRequest:  # a panel came or went: Qt raises what it arranges anew
            QTimer.singleShot(0, self, self._place)
        return False
