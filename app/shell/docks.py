"""Where panels sit: beside the views, in the drawer below everything, and the views in the middle."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Literal

from PySide6.QtCore import QByteArray, QEvent, QObject, QSize, Qt, QTimer
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QAbstractSlider,
    QApplication,
    QDockWidget,
    QMainWindow,
    QSplitter,
    QWidget,
)

from degense.app.shell.column import Column
from degense.widgets import forms
from degense.widgets.scrolling import scrolled

Area = Qt.DockWidgetArea
#: Width of the column beside the views in widths of a character, and height of the drawer in lines of text.
WIDTH, DRAWER = 54, 15
#: The column is no wider than this share of the window, so that the views keep the larger part.
WIDEST = 0.45
#: Height that each panel of the right column has at least, pixels; beyond it, what it has no room for is scrolled.
LEAST = 186
#: Of the arrangement that `state` writes; another version's is left aside.
VERSION = 2


class Docks(QObject):
    """The panels of a window.

    The column at the right holds what is used all the time. The drawer spans the window's whole width and shows one of its panels at a
    time; it is closed at first. Both are dock widgets, which can be dragged out of the window.
    """

    def __init__(self, window: QMainWindow) -> None:
        super().__init__(window)
        self.window = window
        self.all: list[QDockWidget] = []  # in the order they were added
        self.switches: dict[QDockWidget, QAction] = {}  # each opens and closes a panel
        self._drawer: list[QDockWidget] = []
        self._last: QDockWidget | None = None  # panel of the drawer that was open last
        self._drawer_height = 0
        self.below: list[QWidget] = []  # what `add_below` was given
        self._heights: dict[QDockWidget, int] = {}
        self._hidden: list[QWidget] = []  # by `isolate` and `show_page`
        self._alone: QWidget | None = None  # what these showed, and whether it was open before
        self._was_open = False
        self._open_sizes: dict[QDockWidget, QSize] = {}  # of the right column before them
        self._column: dict[QDockWidget, QSize] = {}  # of the right column before the drawer was opened
        self._whole: tuple[str, list[int]] | None = None  # the arrangement before them
        #: In the middle of the window; features put their views there.
        self.views = QSplitter(Qt.Orientation.Horizontal, childrenCollapsible=False)
        self.views.setObjectName("views")
        centre = QWidget()
        self._centre = forms.column((self.views, 1), margin=0, spacing=0, parent=centre)
        window.setCentralWidget(centre)
        self._beside_views = Column(window, centre, self._beside)
        self._beside_views.text_resized.connect(self._text_resized)
        window.setDockOptions(QMainWindow.DockOption.AllowTabbedDocks)
        window.setCorner(Qt.Corner.BottomRightCorner, Area.BottomDockWidgetArea)
        window.setTabPosition(Area.AllDockWidgetAreas, window.tabPosition(Area.TopDockWidgetArea))

    def add(
        self, title: str, widget: QWidget, place: Literal["right", "drawer"] = "drawer", *, height: int = 0, hidden: bool = False
    ) -> QDockWidget:
        """Add a panel, by whose title saved layouts know it. `height` is its share of the right column; a `hidden` one is closed at first.

        Panels scroll where they have no room, so that none can push the window beyond the screen.
        """
        dock = QDockWidget(title, self.window)
        dock.setObjectName(title)
        if not isinstance(widget, QAbstractScrollArea):
            widget = scrolled(widget, title)
            widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        dock.setWidget(widget)
        self.window.addDockWidget(Area.RightDockWidgetArea if place == "right" else Area.BottomDockWidgetArea, dock)
        if place == "right":
            widget.setMinimumHeight(LEAST)
            self.switches[dock] = dock.toggleViewAction()
        else:
            if self._drawer:
                self.window.tabifyDockWidget(self._drawer[-1], dock)
            self._drawer.append(dock)
            dock.installEventFilter(self)
            switch = QAction(title, self, checkable=True)
            switch.triggered.connect(partial(self._switch, dock))
            dock.visibilityChanged.connect(lambda seen: switch.setChecked(dock.isVisibleTo(self.window)))
            self.switches[dock] = switch
        if height:
            self._heights[dock] = height
        if hidden or place == "drawer":
            dock.hide()
        self.all.append(dock)
        return dock

    def add_below(self, widget: QWidget) -> None:
        """Add what stands under the views, between the left edge and the right column."""
        self._centre.addWidget(widget)
        self.below.append(widget)

    @property
    def drawer(self) -> tuple[QDockWidget, ...]:
        """The panels of the drawer."""
        return tuple(self._drawer)

    def arrange(self) -> None:
        """Give the docks their sizes, once all are there."""
        self._drawer_height = DRAWER * self.window.fontMetrics().height()
        if self._heights:
            self.window.resizeDocks(list(self._heights), list(self._heights.values()), Qt.Orientation.Vertical)
            self._set_width()
        # Clicked buttons and sliders leave the keyboard to the window, whose Space and arrows move time. Tab still reaches everything.
        for owner in (*self.all, *self.below):
            for kind in (QAbstractButton, QAbstractSlider):
                for widget in owner.findChildren(kind):
                    if widget.focusPolicy() != Qt.FocusPolicy.NoFocus:
                        widget.setFocusPolicy(Qt.FocusPolicy.TabFocus)

    def _text_resized(self) -> None:
        """Qt paints titles in the size that they began with, unless a panel has another font than the application."""
        font = QApplication.font()
        font.setPointSizeF(font.pointSizeF() + 0.01)
        for dock in self.all:
            dock.setFont(font)
        self._open_sizes = {}  # of text of another size
        self._set_width()

    def _set_width(self) -> None:
        """Give the right column the width that its panels need with text of this size."""
        if docks := [dock for dock in self._beside() if not dock.isHidden()]:
            width = WIDTH * self.window.fontMetrics().averageCharWidth()
            if self.window.isVisible():  # before, it has not its own size
                width = min(width, round(WIDEST * self.window.width()))
            self.window.resizeDocks(docks[:1], [width], Qt.Orientation.Horizontal)

    # The drawer

    def bring(self, dock: QDockWidget) -> None:
        """Show a panel; one of the drawer takes the place of the one that is open there, at the same height."""
        if dock in self._drawer and not dock.isFloating():
            if not self.drawer_is_open():
                self._column = self._sizes()
            others = [other for other in self._drawer if other is not dock and not other.isHidden() and not other.isFloating()]
            self._measure()
            dock.show()
            for other in others:
                other.hide()
            self.window.resizeDocks([dock], [self._height_of_drawer()], Qt.Orientation.Vertical)
            self._last = dock
        dock.show()
        dock.raise_()

    def _height_of_drawer(self) -> int:
        """The height it had, or less where a panel beside the views would not be seen whole."""
        room = self.window.height() - self.window.menuBar().height() - self.window.statusBar().height()
        return max(self._drawer_height // 2, min(self._drawer_height, room - self._beside_views.needed()))

    def is_open(self, dock: QDockWidget) -> bool:
        """Whether a panel is shown, in the window or out of it."""
        return not dock.isHidden()

    def toggle_drawer(self) -> None:
        """Close the drawer, or open it at the panel that was open last."""
        shown = [dock for dock in self._drawer if not dock.isHidden() and not dock.isFloating()]
        self._measure()
        for dock in shown:
            self._close(dock)
        if not shown and self._drawer:
            self.bring(self._last or self._drawer[0])

    def drawer_is_open(self) -> bool:
        return any(not dock.isHidden() and not dock.isFloating() for dock in self._drawer)

    def _switch(self, dock: QDockWidget) -> None:
        if dock.isHidden():
            self.bring(dock)
        else:
            self._measure()
            self._close(dock)

    def _close(self, dock: QDockWidget) -> None:
        """Close a panel of the drawer; the right column is as it was before."""
        dock.hide()
        QTimer.singleShot(0, self, self._drawer_closed)

    def _drawer_closed(self) -> None:
        if not self.drawer_is_open() and self._whole is None:
            self._resize(self._column)

    def _sizes(self) -> dict[QDockWidget, QSize]:
        """Of the right column's open panels."""
        return {dock: dock.size() for dock in self._beside() if dock.isVisible()}

    def _resize(self, sizes: dict[QDockWidget, QSize]) -> None:
        if sizes:
            self.window.resizeDocks(list(sizes), [size.height() for size in sizes.values()], Qt.Orientation.Vertical)
            self.window.resizeDocks(list(sizes), [size.width() for size in sizes.values()], Qt.Orientation.Horizontal)

    def _measure(self) -> None:
        """Remember how high the drawer is, before its panel changes or closes."""
        for dock in self._drawer:
            if dock.isVisible() and not dock.isFloating():
                self._last, self._drawer_height = dock, dock.height()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Close:  # by the cross in its title
            self._measure()
            QTimer.singleShot(0, self, self._drawer_closed)
        return False

    # One task at a time

    def isolate(self, dock: QDockWidget, view: QWidget) -> None:
        """Show one panel of the right column and one view, without the others, until `rejoin`."""
        self.rejoin()
        width = max((other.width() for other in self._beside() if other.isVisible()), default=0)
        views = [shown for index in range(self.views.count()) if (shown := self.views.widget(index)) is not None]
        self._stand_alone(dock, [*self._beside(), *views], but=(dock, view))
        self.window.resizeDocks([dock], [max(width, self._beside_views.width())], Qt.Orientation.Horizontal)

    def add_page(self, page: QWidget) -> None:
        """Add what `show_page` shows."""
        page.hide()
        self._centre.addWidget(page, 1)

    def show_page(self, page: QWidget) -> None:
        """Show a page in place of the views and the panels beside them, until `rejoin`."""
        self.rejoin()
        self._stand_alone(page, [*self._beside(), self.views, *self.below])

    def _beside(self) -> list[QDockWidget]:
        """The panels of the right column."""
        return [dock for dock in self.all if dock not in self._drawer and not dock.isFloating()]

    def _stand_alone(self, shown: QWidget, others: list[QWidget], but: Sequence[QWidget] = ()) -> None:
        self._whole = self.state(), self.views.sizes()
        self._open_sizes = self._sizes()
        self._alone, self._was_open = shown, not shown.isHidden()
        self._hidden = [other for other in others if other not in but and not other.isHidden()]
        for other in self._hidden:  # before the other is shown: all together may need a higher window, which then stays so
            other.hide()
        shown.show()

    def rejoin(self, alone: QWidget | None = None) -> None:
        """Show again what `isolate` or `show_page` hid; nothing when something else than `alone` stands alone."""
        if self._whole is None or self._alone is None or alone not in (None, self._alone):
            return
        (_, sizes), self._whole = self._whole, None
        self._alone.setVisible(self._was_open)
        for other in self._hidden:
            other.show()
        self._hidden = []
        if self._open_sizes:
            self._resize(self._open_sizes)
        else:
            self._set_width()
        self.views.setSizes(sizes)

    # Kept between starts

    def state(self) -> str:
        """The arrangement of the docks as Qt saves it, base64, and after a bar the panel that is open in the drawer."""
        whole = self._whole[0] if self._whole else bytes(self.window.saveState(VERSION).toBase64().data()).decode("ascii")
        opened = next((dock.objectName() for dock in self._drawer if not dock.isHidden() and not dock.isFloating()), "")
        return f"{whole.partition('|')[0]}|{opened}"

    def view_sizes(self) -> list[int]:
        """Widths of the views, pixels."""
        return self._whole[1] if self._whole else self.views.sizes()

    def restore(self, state: str) -> None:
        """Arrange the docks as `state` says; another version's arrangement changes nothing."""
        self.rejoin()
        whole, _, opened = state.partition("|")
        if not self.window.restoreState(QByteArray.fromBase64(whole.encode("ascii", "ignore")), VERSION):
            return
        self._measure()
        for dock in self._drawer:
            if dock.objectName() == opened:
                self.bring(dock)
            elif not dock.isFloating():
                dock.hide()
        QTimer.singleShot(0, self._beside_views, self._beside_views.decide_anew)
        QTimer.singleShot(0, self, self._widen)

    def _widen(self) -> None:
        """Where the arrangement was made with smaller text, its panels may be cut."""
        docks = [dock for dock in self._beside() if dock.isVisible()]
        if docks and max(dock.width() for dock in docks) < (needed := self._beside_views.width()):
            self.window.resizeDocks(docks[:1], [needed], Qt.Orientation.Horizontal)
