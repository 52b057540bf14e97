"""How views follow each other while the slider moves faster than they are drawn."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication

from degense.app.features.viewer import pacing
from degense.app.features.viewer.pacing import Pacing
from degense.engine.scene.clip_query import decode_frame
from tests.app import installed as on


class _Worker(QObject):
    """A worker whose jobs are done when the test says so."""

    freed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.awaited: set[str] = set()

    def busy(self, channel: str) -> bool:
        return channel in self.awaited

    def finish(self, channel: str) -> None:
        self.awaited.discard(channel)
        self.freed.emit(channel)


def _paced() -> tuple[_Worker, list[bool], Pacing]:
    worker, drawn = _Worker(), []

    def draw(quick: bool) -> None:
        drawn.append(quick)
        worker.awaited.add("view")

    return worker, drawn, Pacing(worker, draw, worker)  # type: ignore[arg-type]  # it needs no more of a worker


def test_a_request_at_rest_is_drawn_exactly_at_once(qtbot):
    worker, drawn, pace = _paced()
    pace.request(playing=False)
    assert drawn == [False]
    worker.finish("view")
    pace.request(playing=False)
    worker.finish("view")
    assert drawn == [False, False]
    assert pace.at_rest


def test_a_quick_view_is_drawn_in_both_views_before_the_next(qtbot):
    worker, drawn, pace = _paced()
    for _ in range(2):
        pace.request(playing=False)
    assert drawn == [False, True]  # what was exact is replaced
    for _ in range(20):
        pace.request(playing=False)
    assert drawn == [False, True]
    worker.awaited.add("snapshot")
    worker.finish("view")
    pace.request(playing=False)
    assert drawn == [False, True]  # the 3D view first
    worker.finish("snapshot")
    assert drawn == [False, True, True]  # one for all that waited


def test_the_exact_view_follows_when_nothing_moves(qtbot, monkeypatch):
    monkeypatch.setattr(pacing, "REST_MS", 1)
    worker, drawn, pace = _paced()
    for _ in range(3):
        pace.request(playing=False)
    worker.finish("view")
    worker.finish("view")
    assert not pace.at_rest
    qtbot.waitUntil(lambda: drawn[-1] is False)
    assert drawn == [False, True, True, False]
    worker.finish("view")
    assert pace.at_rest
    assert not pace.quick


def test_while_time_runs_masks_are_quick_and_the_pause_is_exact(qtbot):
    worker, drawn, pace = _paced()
    pace.request(playing=True)
    worker.finish("view")
    pace.request(playing=True)
    pace.draw_exactly()
    assert drawn == [True, True, False]


def test_a_dragged_slider_shows_masks_and_the_3d_view(qtbot, opened, idle, monkeypatch):
    """By the mouse: a move more each time the loop has turned, in both views with the masks of a prompt before the button goes up."""
    opened.session.view.add_prompt("liver")
    idle()
    track, shown, pictures = on.time(opened).timeline.track, [], []
    drawing = on.viewer(opened)
    drawing.shown.connect(lambda view: shown.append(view.frame))
    take = drawing.splats.show_snapshot
    monkeypatch.setattr(drawing.splats, "show_snapshot", lambda image: (pictures.append(drawing.view.frame), take(image)))

    def send(kind: QEvent.Type, frame: float, button: Qt.MouseButton, held: Qt.MouseButton) -> None:
        place = QPointF(track._x(frame), track.height() / 2)
        QApplication.sendEvent(track, QMouseEvent(kind, place, track.mapToGlobal(place), button, held, Qt.KeyboardModifier.NoModifier))

    left, none = Qt.MouseButton.LeftButton, Qt.MouseButton.NoButton
    send(QEvent.Type.MouseButtonPress, 0, left, left)
    moves = iter(range(1, 10_000))

    def enough() -> bool:
        send(QEvent.Type.MouseMove, next(moves) % 9, none, left)
        return len(set(shown)) >= 4 and len(set(pictures)) >= 4

    qtbot.waitUntil(enough)
    send(QEvent.Type.MouseButtonRelease, 3, left, none)
    idle()
    assert drawing.view.frame == opened.session.frame
    exact = decode_frame(opened.session.scene, opened.session.view_state.prompt_set, drawing.view.frame).labels
    assert np.array_equal(drawing.view.masks[..., 3] > 0, exact == 0)
