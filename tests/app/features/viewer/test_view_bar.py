"""The one colour bar over the views leaves the words in the other corner readable."""

from __future__ import annotations

import pytest
from PySide6.QtWidgets import QWidget

from degense.app.features.viewer.view_bar import ViewBar
from tests.app import installed as on

TITLE = "Displacement uncertainty [mm]"


@pytest.mark.parametrize("width", [180, 300, 700])
def test_words_in_the_other_corner_are_not_covered(qtbot, qapp, width):
    view = QWidget()
    qtbot.addWidget(view)
    bar = ViewBar(view)
    view.resize(width, 400)
    view.show()
    bar.show_range(TITLE, 0.0, 9.06, "viridis", (False, True))
    assert view.rect().contains(bar.geometry())
    assert bar.x() > width / 2 or bar.y() > 8 + view.fontMetrics().height()
    assert (bar.y() == 8) == (width == 700)
    assert bar.height() < 5 * view.fontMetrics().height()
    view.resize(900, 400)
    qapp.processEvents()
    assert bar.y() == 8


def test_two_views_have_one_bar(opened, idle):
    opened.session.view.set_layer("displacement")
    idle()
    assert on.viewer(opened).splats.isVisible()
    assert [bar.parent() for bar in opened.findChildren(ViewBar) if bar.isVisible()] == [on.viewer(opened).panel]
    opened.session.view.set_layer("rgb")
    idle()
    assert not any(bar.isVisible() for bar in opened.findChildren(ViewBar))
