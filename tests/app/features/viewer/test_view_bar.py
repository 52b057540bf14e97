"""The colour bar over a view leaves the view's note readable."""

from __future__ import annotations

import pytest
from PySide6.QtWidgets import QLabel, QWidget

from degense.app.features.viewer.view_bar import ViewBar


@pytest.mark.parametrize("width", [180, 250, 700])
def test_the_note_is_not_covered(qtbot, qapp, width):
    view = QWidget()
    qtbot.addWidget(view)
    note = QLabel("Surgeon’s view", view)
    note.setObjectName("viewNote")
    note.move(8, 8)
    note.adjustSize()
    bar = ViewBar(view)
    view.resize(width, 400)
    view.show()
    bar.show_range("Displacement [mm]", 0.0, 9.06, "viridis", (False, True))
    assert not bar.geometry().intersects(note.geometry())
    assert (bar.y() == 8) == (width == 700)
    view.resize(900, 400)
    qapp.processEvents()
    assert bar.y() == 8
