"""Curves, ticks and read-outs."""

from __future__ import annotations

import gc
import math
import subprocess
import sys
import weakref

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from degense.widgets.curve_plot import CurvePlot
from degense.widgets.numbers import short
from degense.widgets.qt_images import to_array
from degense.widgets.theme import apply_theme
from tests.house.source import ROOT

RED = QColor(255, 0, 0)


@pytest.fixture
def plot(show):
    return show(CurvePlot(), 400, 220)


def pixels(plot):
    QApplication.processEvents()  # it is laid out anew
    return to_array(plot.grab().toImage())


def red(plot):
    """Rows and columns of the red pixels below the legend."""
    rows, columns = np.nonzero(pixels(plot)[25:].astype(int) @ [1, -1, -1] > 0)
    return rows + 25, columns


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (12.0, "12"), (12.345, "12.3"), (0.5, "0.5"), (1e-5, "1.00e-5"), (1234567.0, "1.23e6"), (-0.25, "-0.25"), (math.nan, "–")],
)
def test_short_numbers(value, text):
    assert short(value) == text


def test_a_rising_curve_rises(plot):
    plot.set_series("a", np.arange(50), np.arange(50) * 2.0, RED)
    rows, columns = red(plot)
    assert columns.max() - columns.min() > 250
    left, right = rows[columns < columns.min() + 20].mean(), rows[columns > columns.max() - 20].mean()
    assert left - right > 100


def test_axes_say_what_they_count_where_there_is_room(plot):
    plot.set_labels("frame", "displacement [mm]")
    plot.set_series("a", np.arange(50), np.arange(50) * 2.0, RED)
    left, bottom = plot._view._axes
    for height, there in ((220, True), (100, False), (220, True)):
        plot.resize(400, height)
        QApplication.processEvents()
        assert (left.label.isVisible(), bottom.label.isVisible()) == (there, there)
        assert (left.labelText, bottom.labelText) == ("displacement [mm]", "frame")
        assert ("displacement" in plot._view._legend.text) is not there  # it is said once
    bare = pixels(plot)[30:190, :20].astype(int)
    plot.set_labels("frame", "")
    assert not left.label.isVisible()
    assert np.abs(bare - bare[0, 0]).max() > 40  # something is written along the axis


def test_the_legend_can_be_read_after_the_theme_has_changed(plot, qapp):
    plot.set_series("displacement", np.arange(50), np.arange(50) * 2.0, RED)
    for name in ("light", "dark"):
        apply_theme(qapp, name)
        QApplication.processEvents()
        assert plot._view._legend.opts["color"] == plot.palette().text().color()


def test_log_scale_bends_exponentials_straight(show):
    plot = show(CurvePlot(log=True), 400, 220)
    plot.set_series("a", np.arange(50), 10.0 ** (np.arange(50) / 10), RED)
    rows, columns = red(plot)
    slope, offset = np.polyfit(columns, rows, 1)
    assert np.abs(rows - slope * columns - offset).max() < 3


def test_gaps_and_hostile_values(plot):
    y = np.ones(40)
    y[10:30] = np.nan
    plot.set_series("a", np.arange(40), y, RED)
    columns = np.unique(red(plot)[1])
    assert np.diff(columns).max() > 150


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("values", [[math.nan] * 3, [math.inf, -math.inf, 1.0], [0.0, 0.0, 0.0], [1e300, -1e300, 0.0], [1e-300, 1.0, 1e90]])
def test_hostile_values(show, log, values):
    plot = show(CurvePlot(log=log), 400, 220)
    plot.set_series("a", np.arange(3), values)
    pixels(plot)


def test_one_point_and_none(plot):
    empty = pixels(plot)
    plot.append("a", 3, 4.0)
    assert (pixels(plot) != empty).any()
    plot.clear()
    assert (pixels(plot) == empty).all()
    plot.set_message("No loss yet")
    assert (pixels(plot) != empty).any()
    with pytest.raises(ValueError, match="3 positions and 2 values"):
        plot.set_series("a", np.zeros(3), np.zeros(2))


def test_growing_keeps_names_and_colours(plot):
    for i in range(5):
        plot.append("loss", i, 1.0 / (i + 1))
    plot.append("psnr", 0, 20.0)
    assert list(plot.series) == ["loss", "psnr"]


def test_clicks_give_points_of_the_curves(plot):
    heard: list = []
    plot.x_clicked.connect(heard.append)
    QTest.mouseClick(plot, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, QPoint(200, 100))
    assert heard == []
    plot.set_series("a", np.arange(0, 50, 10), np.ones(5))
    for x in (388, 215, 60):
        QTest.mouseClick(plot, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, QPoint(x, 100))
    assert heard[:2] == [40.0, 20.0]
    assert heard == sorted(heard, reverse=True)


def test_cursor_and_read_out(plot, qtbot):
    plot.set_series("a", np.arange(50), np.ones(50), RED)
    plain = pixels(plot)
    plot.set_cursor(25)
    changed = (pixels(plot) != plain).any(-1)
    assert changed.any(0).sum() < 8
    assert changed.any(1).sum() > 100
    plot.set_cursor(None)
    QTest.mouseMove(plot, QPoint(200, 100))
    qtbot.waitUntil(lambda: (pixels(plot)[:20] != plain[:20]).any())


def test_a_spike_in_a_long_run_is_seen(plot):
    values = np.zeros(100_000)
    values[31_007] = 1.0
    plot.set_series("a", np.arange(len(values)), values, RED)
    rows, columns = red(plot)
    assert rows.max() - rows.min() > 100
    assert np.ptp(columns[rows < rows.min() + 20]) < 8


def test_a_long_run_is_thinned(plot):
    """A hundred thousand points are painted as a few hundred, and their ends stay."""
    n = 100_000
    plot.set_series("a", np.arange(n), np.linspace(0, 1, n), RED)
    long = red(plot)
    plot.set_series("a", np.array([0, n - 1]), np.array([0.0, 1.0]), RED)
    short_ = red(plot)
    assert abs(long[1].max() - short_[1].max()) <= 1
    assert abs(long[0].min() - short_[0].min()) <= 1


def test_curves_come_and_go_and_leave_nothing(plot):
    """Each time that a line was added again PySide kept weak references to it: some hundred for every run that was opened."""

    def references() -> int:
        gc.collect()
        return sum(type(thing) is weakref.ReferenceType for thing in gc.get_objects())

    def draw() -> None:
        plot.set_series("a", np.arange(5.0), np.arange(5.0))
        plot.set_cursor(2.0)
        plot.clear()

    draw()
    before = references()
    for _ in range(20):
        draw()
    assert references() <= before + 10


def test_a_plot_that_is_not_shown_can_be_saved_as_a_picture():
    plot = CurvePlot()
    plot.resize(400, 220)
    plot.set_series("a", np.arange(50), np.arange(50) * 2.0, RED)
    assert np.ptp(red(plot)[1]) > 250


#: A program of its own: other tests have made curves. Prints whether pyqtgraph is there before and after one is made.
FIRST = """
import sys
import numpy as np
from PySide6.QtWidgets import QApplication
from degense.widgets.curve_plot import CurvePlot

app, plot = QApplication([]), CurvePlot()
plot.show()
empty = "pyqtgraph" in sys.modules
plot.set_series("a", np.arange(3), np.ones(3))
print(empty, "pyqtgraph" in sys.modules)
"""


def test_pyqtgraph_comes_with_the_first_curve():
    child = subprocess.run([sys.executable, "-c", FIRST], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert child.returncode == 0, child.stderr
    assert child.stdout.split() == ["False", "True"]
