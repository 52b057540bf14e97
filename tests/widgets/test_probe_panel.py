"""The table of values and its curves."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel, QTableWidget

from degense.app.features.inspect.probe_panel import ProbePanel
from degense.widgets.curve_plot import CurvePlot
from degense.widgets.glyphs import GlyphButton


@pytest.fixture
def probe(show):
    return show(ProbePanel(), 280, 400)


def cells(probe):
    table = probe.findChild(QTableWidget)
    return [tuple(table.item(i, j).text() for j in range(2)) for i in range(table.rowCount())]


def test_rows(probe):
    rows = [("Depth", "43.1 mm"), ("Warp", "0.2 px"), ("Class", "liver")]
    probe.set_values(rows)
    assert cells(probe) == rows
    table = probe.findChild(QTableWidget)
    first = table.item(0, 1)
    probe.set_values([("Depth", "44.0 mm"), *rows[1:]])
    assert table.item(0, 1) is first  # reused, not rebuilt, at every movement of the pointer
    assert cells(probe)[0] == ("Depth", "44.0 mm")
    probe.set_values(rows[:1])
    assert cells(probe) == rows[:1]
    probe.clear()
    assert cells(probe) == []


def test_nothing_needs_scrolling(probe):
    probe.set_values([(f"value {i}", "1") for i in range(7)])
    table = probe.findChild(QTableWidget)
    assert table.verticalScrollBar().maximum() == 0


def test_pinning(probe):
    heard: list = []
    probe.unpin_requested.connect(lambda: heard.append(1))
    unpin = probe.findChild(GlyphButton)
    assert not unpin.isVisible()
    probe.set_pinned("Pinned at (3, 4)")
    assert any(label.text() == "Pinned at (3, 4)" for label in probe.findChildren(QLabel))
    QTest.mouseClick(unpin, Qt.MouseButton.LeftButton)
    assert heard == [1]
    probe.set_pinned("")
    assert not unpin.isVisible()


def test_swatch(probe):
    swatch = next(label for label in probe.findChildren(QLabel) if label.accessibleName() == "Colour under the cursor")
    probe.set_colour(QColor(1, 2, 3))
    assert swatch.isVisible()
    assert swatch.pixmap().toImage().pixelColor(3, 3) == QColor(1, 2, 3)
    probe.set_colour(None)
    assert not swatch.isVisible()


def test_curves_and_jumping_to_frames(probe):
    heard: list = []
    probe.frame_clicked.connect(heard.append)
    probe.plot.set_series("displacement [mm]", np.arange(10), np.arange(10.0))
    probe.plot.set_cursor(4)
    plot = probe.findChild(CurvePlot)
    assert list(plot.series) == ["displacement [mm]"]
    QTest.mouseClick(plot, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, QPoint(plot.width() - 8, 60))
    assert heard == [9]
    probe.plot.clear()
    assert list(plot.series) == []
