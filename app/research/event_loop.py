"""Waiting for the window as a user does: until a frame has been painted, until the worker rests; and how evenly its event loop beats."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, QEventLoop, QObject, Qt, QTimer
from PySide6.QtWidgets import QApplication, QWidget

from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.app.features.viewer.controller import Viewer
    from degense.app.shell.shell import Shell

BEAT_MS, PATIENCE = 4, 60.0


class Painted(QObject):
    """Counts the paintings of a widget that show what is awaited."""

    def __init__(self, widget: QWidget, there: Callable[[], bool]) -> None:
        super().__init__(widget)
        self.there, self.count = there, 0
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and self.there():
            QTimer.singleShot(0, self, self._painted)  # after the painting itself
        return False

    def _painted(self) -> None:
        self.count += 1


def timed(window: Shell, act: Callable[[], object]) -> float:
    """Milliseconds from `act` until the complete view that answers it is painted in 2D."""
    drawing = viewer(window)
    before = drawing.view
    start = time.perf_counter()
    act()
    painted(drawing.panel, lambda: drawing.view is not None and drawing.view is not before and drawing.view.complete)
    return 1000 * (time.perf_counter() - start)


def timed_in_3d(window: Shell, act: Callable[[], object]) -> float:
    """Milliseconds from `act` until the 3D view that answers it is painted."""
    drawing = viewer(window)
    canvas = drawing.splats.focusProxy() if drawing.splats is not None else None
    assert canvas is not None
    before = drawing.view
    start = time.perf_counter()
    act()
    painted(canvas, lambda: drawing.view is not before and not window.worker.busy("snapshot"))
    return 1000 * (time.perf_counter() - start)


def viewer(window: Shell) -> Viewer:
    """The views of the window."""
    from degense.app.features.viewer.controller import Viewer

    found = window.service(Viewer)
    assert found is not None
    return found


def painted(widget: QWidget, there: Callable[[], bool]) -> None:
    """Wait until a view has been painted with something there."""
    watch = Painted(widget, there)
    wait(lambda: watch.count > 0)
    watch.deleteLater()


def rest(window: Shell) -> None:
    """Wait until the worker has nothing to do and all is painted."""
    wait(window.worker.idle)
    run_events(0.03)


def wait(until: Callable[[], bool]) -> None:
    """Run the event loop until something is so; DegenseError when it is not within a minute."""
    end = time.perf_counter() + PATIENCE
    while not until():
        if time.perf_counter() > end:
            raise DegenseError("The window did not answer within a minute, so it cannot be measured.")
        QApplication.processEvents(QEventLoop.ProcessEventsFlag.AllEvents, 5)
        time.sleep(0.0005)


def run_events(seconds: float) -> None:
    """Run the event loop as the program does. `QTest.qWait` would keep the interpreter to itself, and the worker from working."""
    loop = QEventLoop()
    QTimer.singleShot(round(1000 * seconds), loop.quit)
    loop.exec()


def beats(seconds: float) -> list[float]:
    """Gaps between the beats of a timer, less its interval, milliseconds."""
    gaps: list[float] = []
    last = time.perf_counter()

    def beat() -> None:
        nonlocal last
        now = time.perf_counter()
        gaps.append(max(0.0, 1000 * (now - last) - BEAT_MS))
        last = now

    timer = QTimer()
    timer.setTimerType(Qt.TimerType.PreciseTimer)
    timer.timeout.connect(beat)
    timer.start(BEAT_MS)
    run_events(seconds)
    timer.stop()
    return gaps
