"""When views are drawn: at once; one after the other, each in both views and with its masks, while requests come faster than that."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer

from degense.app.shell.worker import Worker

#: What one view takes of the worker.
CHANNELS = ("view", "snapshot")
#: How long nothing may be requested until the exact masks follow quick ones.
REST_MS = 150


class Pacing(QObject):
    """Passes requests on to `draw`, which submits a view; its argument is whether masks are to be decoded pixel by pixel, which is quick.

    A request replaces an exact view that is being drawn, and waits for a quick one: a slider that moves faster than views are drawn would
    otherwise see neither masks nor the 3D view.
    """

    def __init__(self, worker: Worker, draw: Callable[[bool], None], parent: QObject) -> None:
        super().__init__(parent)
        self._worker, self._draw = worker, draw
        self.quick = False  # whether time runs, or requests come faster than views are drawn
        self._waiting = False
        self._rest = QTimer(self, singleShot=True, interval=REST_MS)
        self._rest.timeout.connect(self.draw_exactly)
        worker.freed.connect(self._freed)

    @property
    def at_rest(self) -> bool:
        """Whether nothing is left to draw but what is being drawn."""
        return not self._waiting and not self._rest.isActive()

    def request(self, playing: bool) -> None:
        """Draw what is shown now, once that is due."""
        self._rest.stop()
        self._waiting = self.quick and self._drawing()
        if not self._waiting:
            self.quick = playing or self._worker.busy("view")
            self._draw(self.quick)

    def draw_exactly(self) -> None:
        """Draw what is shown now at once."""
        self._rest.stop()
        self.quick = self._waiting = False
        self._draw(False)

    def _drawing(self) -> bool:
        return any(self._worker.busy(channel) for channel in CHANNELS)

    def _freed(self, channel: str) -> None:
        if channel not in CHANNELS or self._drawing():
            return
        if self._waiting:
            self._waiting = False
            self._draw(True)
        elif self.quick:
            self._rest.start()
