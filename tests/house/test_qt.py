"""The installed Qt is sound."""

from __future__ import annotations

import sys

from PySide6.QtCore import QObject, QPointF, QTimer


def test_void_calls_keep_their_references_to_none():
    """PySide6 6.12.0 loses one reference to None a call before Python 3.12, and aborts the process when none is left.

    From Python 3.12 on None is immortal and its count says nothing.
    """
    thing, timer, point = QObject(), QTimer(), QPointF()
    before = sys.getrefcount(None)
    for _ in range(1000):
        thing.setObjectName("a")
        timer.setInterval(5)
        point.setX(1.0)
    assert abs(sys.getrefcount(None) - before) < 100
