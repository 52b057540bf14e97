"""The status bar: what the mouse does here, what needs attention, what is being done, and a button for each panel of the drawer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from types import MappingProxyType

from PySide6.QtCore import QObject, Qt
from PySide6.QtGui import QAction, QIcon
from PySide6.QtWidgets import QLabel, QMainWindow, QProgressBar, QSizePolicy, QToolBar, QToolButton

from degense.widgets import forms
from degense.widgets.elided import ElidedLabel

#: Room that hints and messages keep beside the buttons, characters.
WORDS = 24


class StatusBar(QObject):
    """The parts of a window's status bar. Messages (`Shell.say`) cover the hint only."""

    def __init__(self, window: QMainWindow) -> None:
        super().__init__(window)
        bar = window.statusBar()
        bar.setSizeGripEnabled(False)
        self._links: dict[str, Callable[[], object]] = {}
        self.hint = ElidedLabel("What the mouse does here", secondary=True, least=WORDS)
        self.message = ElidedLabel("Message", least=WORDS)  # what Qt would paint itself, cut without a sign
        self.message.hide()
        bar.addPermanentWidget(self.hint, 1)
        bar.addPermanentWidget(self.message, 1)
        bar.messageChanged.connect(self._show_message)
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
        self.stop = forms.button("Cancel", lambda: self._stop())
        for part in (self.busy_text, self.busy_bar, self.stop):
            bar.addPermanentWidget(part)
        #: Buttons that do not fit are in a menu at its end.
        self.stripe = forms.named(QToolBar(movable=False, floatable=False), "Panels of the drawer")
        self.stripe.setObjectName("stripe")
        self.more = self.stripe.findChild(QToolButton, "qt_toolbar_ext_button")
        if self.more is not None:  # its own icon is black in every theme
            self.more.setIcon(QIcon())
            self.more.setText("»")
            self.more.setAccessibleName("More panels")
        bar.addPermanentWidget(self.stripe)
        self.set_busy()
        self.set_notice()

    def _show_message(self, text: str) -> None:
        self.message.setText(text)
        self.message.setVisible(bool(text))
        self.hint.setVisible(not text)

    def add_button(self, action: QAction) -> None:
        """Add the switch of a panel to the stripe."""
        self.stripe.addAction(action)
        button = self.stripe.widgetForAction(action)
        assert isinstance(button, QToolButton)
        button.setAccessibleName(action.text())
        button.setFocusPolicy(Qt.FocusPolicy.TabFocus)

    def set_busy(self, text: str = "", fraction: float | None = None, stop: Callable[[], object] | None = None) -> None:
        """Show that something is being done; an empty text hides it. Without a fraction the bar only moves. A button calls `stop`."""
        self._stop = stop or (lambda: None)
        self.stop.setVisible(stop is not None)
        self.busy_text.setText(text)
        self.busy_text.setVisible(bool(text))
        self.busy_bar.setVisible(bool(text))
        self.busy_bar.setRange(0, 0 if fraction is None else 100)
        if fraction is not None:
            self.busy_bar.setValue(round(100 * fraction))

    def set_notice(self, text: str = "", links: Mapping[str, Callable[[], object]] = MappingProxyType({})) -> None:
        """Keep a sentence in the status bar, with what can be done about it, until another takes its place; no text hides it."""
        self._links = dict(links)
        offers = " ".join(f"<a href='{escape(title)}'>{escape(title)}</a>" for title in links)
        self.notice.setText(f"{offers} &nbsp;⚠ {escape(text)}")
        self.notice.setToolTip(text)
        self.notice.setVisible(bool(text))
