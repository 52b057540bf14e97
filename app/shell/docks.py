"""Where panels sit: the right column, its tabs, the bottom, the views in the middle, and the status bar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from types import MappingProxyType
from typing import Literal

from PySide6.QtCore import QByteArray, QObject, Qt
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QDockWidget,
    QLabel,
    QMainWindow,
    QProgressBar,
    QSizePolicy,
    QSplitter,
    QWidget,
)

from degense.widgets import forms

Area = Qt.DockWidgetArea
WIDTH, SMALL = 436, 130  # of the right column; height of the panels above one that needs room; pixels


class Docks(QObject):
    """The panels of a window."""

    def __init__(self, window: QMainWindow) -> None:
        super().__init__(window)
        self.window = window
        self.all: list[QDockWidget] = []  # in the order they were added
        self._tabs: list[QDockWidget] = []
        self._below: list[QWidget] = []
        self._heights: dict[QDockWidget, int] = {}
        self._links: dict[str, Callable[[], object]] = {}
        #: In the middle of the window; features put their views there.
        self.views = QSplitter(Qt.Orientation.Horizontal, childrenCollapsible=False)
        self.views.setObjectName("views")
        centre = QWidget()
        self._centre = forms.column((self.views, 1), margin=0, spacing=0, parent=centre)
        window.setCentralWidget(centre)
        window.setDockOptions(QMainWindow.DockOption.AllowTabbedDocks | QMainWindow.DockOption.AnimatedDocks)
        window.setTabPosition(Area.AllDockWidgetAreas, window.tabPosition(Area.TopDockWidgetArea))
        self._add_status_bar()

    def add(
        self, title: str, widget: QWidget, place: Literal["right", "tab", "bottom"] = "tab", *, height: int = 0, hidden: bool = False
    ) -> QDockWidget:
        """Add a panel, by whose title saved layouts know it: in the right column, as one of the tabs in its lower part, or at the bottom.

        Tabs scroll, so that no panel can push the window beyond the screen. `height` is a share of the right column, pixels; of tabs the
        first one's counts. A `hidden` one is closed at first; the bottom ones always are.
        """
        dock = QDockWidget(title, self.window)
        dock.setObjectName(title)
        if place == "tab":
            widget = forms.scrolled(widget, title)
            widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        dock.setWidget(widget)
        self.window.addDockWidget(Area.BottomDockWidgetArea if place == "bottom" else Area.RightDockWidgetArea, dock)
        if place == "tab":
            if self._tabs:
                self.window.tabifyDockWidget(self._tabs[-1], dock)
            self._tabs.append(dock)
        if height:
            self._heights[dock] = height
        if hidden or place == "bottom":
            dock.hide()
        self.all.append(dock)
        return dock

    def add_below(self, widget: QWidget) -> None:
        self._centre.addWidget(widget)
        self._below.append(widget)

    def arrange(self) -> None:
        """Give the docks their sizes, once all are there."""
        if self._heights:
            self.window.resizeDocks(list(self._heights), list(self._heights.values()), Qt.Orientation.Vertical)
            self.window.resizeDocks([next(iter(self._heights))], [WIDTH], Qt.Orientation.Horizontal)
        if self._tabs:
            self._tabs[0].raise_()
        # Clicked buttons and sliders leave the keyboard to the window, whose Space and arrows move time. Tab still reaches everything.
        for owner in (*self.all, *self._below):
            for kind in (QAbstractButton, QAbstractSlider):
                for widget in owner.findChildren(kind):
                    if widget.focusPolicy() != Qt.FocusPolicy.NoFocus:
                        widget.setFocusPolicy(Qt.FocusPolicy.TabFocus)

    def bring(self, dock: QDockWidget, height: int = 0) -> None:
        """Show a dock in front of its tabs; with a height, at the cost of the panels above it."""
        dock.show()
        dock.raise_()
        if height:
            above = [other for other in self._heights if other not in self._tabs] if dock in self._tabs else []
            self.window.resizeDocks([*above, dock], [*[SMALL] * len(above), height], Qt.Orientation.Vertical)

    def state(self) -> str:
        """The arrangement of the docks as Qt saves it, base64."""
        return bytes(self.window.saveState().toBase64().data()).decode("ascii")

    def restore(self, state: str) -> None:
        self.window.restoreState(QByteArray.fromBase64(state.encode("ascii", "ignore")))

    def set_busy(self, text: str = "", fraction: float | None = None) -> None:
        """Show that something is being done; an empty text hides it. Without a fraction the bar only moves."""
        self.busy_text.setText(text)
        self.busy_text.setVisible(bool(text))
        self.busy_bar.setVisible(bool(text))
        self.busy_bar.setRange(0, 0 if fraction is None else 100)
        if fraction is not None:
            self.busy_bar.setValue(round(100 * fraction))

    def set_notice(self, text: str = "", links: Mapping[str, Callable[[], object]] = MappingProxyType({})) -> None:
        """Keep a sentence in the status bar, with what can be done about it, until another takes its place; no text hides it."""
        self._links = dict(links)
        self.notice.setText(f"{' '.join(f'<a href={title!r}>{escape(title)}</a>' for title in links)} &nbsp;⚠ {escape(text)}")
        self.notice.setToolTip(text)
        self.notice.setVisible(bool(text))

    def _add_status_bar(self) -> None:
        bar = self.window.statusBar()
        self.hint = forms.label(secondary=True, wrap=False)
        self.hint.setAccessibleName("What the mouse does here")
        self.hint.setMinimumWidth(1)
        bar.addWidget(self.hint, 1)
        self.notice = forms.complaint()
        self.notice.setAccessibleName("What needs attention")
        self.notice.setTextFormat(Qt.TextFormat.RichText)
        self.notice.setWordWrap(False)
        self.notice.setMinimumWidth(1)  # a long sentence is cut at its end, never the window widened
        self.notice.setTextInteractionFlags(
            Qt.TextInteractionFlag.LinksAccessibleByMouse | Qt.TextInteractionFlag.LinksAccessibleByKeyboard
        )
        self.notice.linkActivated.connect(lambda title: self._links[title]())
        bar.addPermanentWidget(self.notice)
        self.busy_text, self.busy_bar = QLabel(), forms.named(QProgressBar(textVisible=False), "What is being done")
        self.busy_bar.setFixedWidth(140)
        self.busy_bar.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
        bar.addPermanentWidget(self.busy_text)
        bar.addPermanentWidget(self.busy_bar)
        self.set_busy()
        self.set_notice()
