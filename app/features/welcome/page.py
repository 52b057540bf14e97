"""What is seen while nothing is open: ways to begin, what was open lately, and tasks to try."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QFont, QFontMetrics, QIcon, QPainter, QPixmap
from PySide6.QtWidgets import QFrame, QLabel, QListWidget, QListWidgetItem, QPushButton, QScrollArea, QWidget

from degense.app.features.welcome.thumbnails import HEIGHT, WIDTH, thumbnail
from degense.widgets import forms
from degense.widgets.keys import ARROWS, PRESS, keep_keys

#: A button: its title, what it is good for, and what it does.
Entry = tuple[str, str, Callable[[], object]]
_PATH = Qt.ItemDataRole.UserRole
#: Around the text of a button, pixels.
EDGE = 8


class WelcomePage(QScrollArea):
    """Two columns: beginning and trying at the left, recent work at the right. Tab and the arrows reach all of it."""

    chosen = Signal(str)  # (path) of recent work

    def __init__(self, ways: Sequence[Entry], tasks: Sequence[Entry], tour: Callable[[], object]) -> None:
        super().__init__(widgetResizable=True)
        self.setAccessibleName("Welcome")
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.ways, self.tasks = [_link(*way) for way in ways], [_link(*task) for task in tasks]
        self.tour = forms.button("Take the tour", tour, "Five steps through the window; also in the Help menu")
        self.recent = QListWidget()
        self.recent.setAccessibleName("Opened lately")
        self.recent.setIconSize(QSize(WIDTH, HEIGHT))
        self.recent.setFrameShape(QFrame.Shape.NoFrame)
        self.recent.setSpacing(3)
        self.recent.setWordWrap(True)
        self.recent.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.recent.viewport().setAutoFillBackground(False)
        keep_keys(self.recent, ARROWS | PRESS)
        self.recent.itemActivated.connect(self._choose)
        self.recent.itemClicked.connect(self._choose)
        self.nothing = forms.label("What you open appears here.", secondary=True)
        left = forms.column(
            _heading("Begin"),
            *self.ways,
            8,
            _heading("Try it on the demo"),
            *self.tasks,
            8,
            forms.row(self.tour, 0),
            0,
            margin=0,
            spacing=2,
        )
        right = forms.column(_heading("Opened lately"), self.nothing, (self.recent, 100), 0, margin=0, spacing=2)
        content = QWidget()
        columns = forms.row((left, 4), (right, 5), spacing=36)
        forms.column(_title(), (columns, 1), margin=24, spacing=14, parent=content)
        content.setMaximumWidth(1100)
        middle = QWidget()
        forms.row(0, (content, 100), 0, parent=middle)
        self.setWidget(middle)

    def set_recent(self, paths: Sequence[str]) -> None:
        """List these, each with its picture."""
        self.recent.clear()
        for text in paths:
            path = Path(text)
            item = QListWidgetItem(QIcon(_framed(thumbnail(path))), f"{path.name}\n{path.parent}")
            item.setData(_PATH, text)
            item.setToolTip(text)
            self.recent.addItem(item)
        self.nothing.setVisible(not paths)
        self.recent.setVisible(bool(paths))

    def _choose(self, item: QListWidgetItem) -> None:
        self.chosen.emit(item.data(_PATH))


class _Link(forms.Painted, QPushButton):
    """A button of two lines, its title and what it is good for; text of a `QCommandLinkButton` is of one size."""

    def __init__(self, title: str, help_: str) -> None:
        super().__init__(title)
        self._help = help_
        forms.named(self, f"{title}: {help_}")
        self.setAttribute(Qt.WidgetAttribute.WA_Hover)
        self.setAutoDefault(True)  # Enter presses it too
        keep_keys(self, PRESS)

    def _bold(self) -> QFont:
        font = QFont(self.font())
        font.setBold(True)
        return font

    def sizeHint(self) -> QSize:
        width = max(QFontMetrics(self._bold()).horizontalAdvance(self.text()), self.fontMetrics().horizontalAdvance(self._help))
        return QSize(width + 2 * EDGE, 2 * self.fontMetrics().height() + 2 * EDGE)

    def minimumSizeHint(self) -> QSize:
        return self.sizeHint()

    def _paint(self, painter: QPainter) -> None:
        palette, inside = self.palette(), self.rect().adjusted(EDGE, EDGE, -EDGE, -EDGE)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(palette.color(palette.ColorRole.Accent) if self.hasFocus() else Qt.PenStyle.NoPen)
        painter.setBrush(palette.color(palette.ColorRole.Midlight) if self.underMouse() or self.isDown() else Qt.BrushStyle.NoBrush)
        painter.drawRoundedRect(self.rect().adjusted(1, 1, -2, -2), 4, 4)
        painter.setPen(palette.color(palette.ColorRole.WindowText))
        painter.drawText(inside, Qt.AlignmentFlag.AlignBottom, self._help)
        painter.setFont(self._bold())
        painter.drawText(inside, Qt.AlignmentFlag.AlignTop, self.text())


def _link(title: str, help_: str, run: Callable[[], object]) -> _Link:
    button = _Link(title, help_)
    button.clicked.connect(lambda checked: run())
    return button


def _title() -> QLabel:
    """As large as text of the window makes it."""
    return QLabel("<span style='font-size: xx-large'>DeGense</span>", textFormat=Qt.TextFormat.RichText)


def _heading(text: str) -> QLabel:
    heading = forms.label(text)
    font = heading.font()
    font.setBold(True)
    heading.setFont(font)
    return heading


def _framed(picture: QPixmap) -> QPixmap:
    """The picture in the middle of one that is always of the same size, so that names stand below each other."""
    framed = QPixmap(WIDTH, HEIGHT)
    framed.fill(Qt.GlobalColor.transparent)
    if not picture.isNull():
        with QPainter(framed) as painter:
            painter.drawPixmap((WIDTH - picture.width()) // 2, (HEIGHT - picture.height()) // 2, picture)
    return framed
