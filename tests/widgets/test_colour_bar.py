"""The colour bar: its range, who sets it, and what it paints."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage, QPainter
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox, QLabel, QLineEdit

from degense.engine.colour_maps import colour_table
from degense.widgets.colour_bar import ColourBar, Gradient
from degense.widgets.qt_images import to_array


@pytest.fixture
def bar(show):
    bar = show(ColourBar(), 300, 120)
    bar.set_range(0.0, 10.0)
    return bar


def named(bar, kind, name):
    return next(w for w in bar.findChildren(kind) if w.accessibleName() == name)


@pytest.fixture
def heard(bar):
    events: list = []
    bar.changed.connect(events.append)
    return events


def type_in(field, text):
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, text)
    QTest.keyClick(field, Qt.Key.Key_Return)


def test_programs_are_silent(bar, heard):
    bar.set_range(-3.0, 4.5)
    bar.set_range_mode("frame")
    bar.set_cmap("vik")
    bar.set_title("Displacement [mm]")
    assert bar.range() == (-3.0, 4.5)
    assert (bar.range_mode(), bar.cmap()) == ("frame", "vik")
    assert any(label.text() == "Displacement [mm]" for label in bar.findChildren(QLabel))
    assert heard == []


def test_ends_say_what_lies_beyond():
    drawn: list[str] = []

    class Painter(QPainter):
        def drawText(self, *args) -> None:
            drawn.append(args[-1])

    gradient = Gradient()
    gradient.low, gradient.high, gradient.beyond = 2.0, 9.06, (False, True)
    canvas = QImage(140, 300, QImage.Format.Format_RGB32)
    with Painter(canvas) as painter:
        gradient._paint(painter)
    assert {"2", "≥ 9.06"} <= set(drawn)
    assert not any(text.startswith("≤") for text in drawn)


def test_typing_fixes_the_range(bar, heard):
    bar.set_range_mode("sequence")
    type_in(named(bar, QLineEdit, "Highest value"), "2,5")
    assert heard == [{"mode": "fixed", "low": 0.0, "high": 2.5}]
    type_in(named(bar, QLineEdit, "Lowest value"), "-1e-1")
    assert heard[1:] == [{"mode": "fixed", "low": -0.1, "high": 2.5}]
    assert bar.range_mode() == "fixed"


@pytest.mark.parametrize("text", ["", "abc", "nan", "inf", "-5", "0"])
def test_nonsense_is_put_back(bar, heard, text):
    field = named(bar, QLineEdit, "Highest value")
    type_in(field, text) if text else (field.setModified(True), field.clear(), field.setModified(True), field.editingFinished.emit())
    assert bar.range() == (0.0, 10.0)
    assert field.text() == "10"
    assert heard == []


def test_leaving_a_field_untouched_changes_nothing(bar, heard):
    bar.set_range(1 / 3, 2 / 3)
    named(bar, QLineEdit, "Highest value").setFocus()
    named(bar, QLineEdit, "Lowest value").setFocus()
    assert heard == []
    type_in(named(bar, QLineEdit, "Highest value"), "0.9")
    assert bar.range() == (1 / 3, 0.9)  # the end that was not typed keeps all its digits


def test_choices(bar, heard):
    QTest.keyClick(named(bar, QComboBox, "Range of the colours"), Qt.Key.Key_Up)
    QTest.keyClick(named(bar, QComboBox, "Colour map"), Qt.Key.Key_Down)
    assert heard == [{"mode": "frame", "low": 0.0, "high": 10.0}, {"cmap": "cividis"}]
    assert bar.cmap() == "cividis"


def test_the_gradient_runs_to_the_right(show):
    gradient = show(Gradient(), 300, 40)
    gradient.cmap = "magma"
    index = indices(to_array(gradient.grab().toImage())[4, 2:-2], "magma")
    assert (np.diff(index) >= 0).all()
    assert index[0] < 10
    assert index[-1] > 245


def test_the_choice_of_a_map_shows_its_colours(bar):
    box = named(bar, QComboBox, "Colour map")
    bar.set_cmap("magma")
    row = to_array(box.grab().toImage())[box.height() // 2, 10 : box.width() - 40]
    index = indices(row, "magma")
    assert (np.diff(index) >= 0).all()
    assert index[-1] - index[0] > 200
    assert np.abs(colour_table("magma").astype(int)[index] - row).max() <= 2


def test_numbers_of_a_narrow_bar_leave_each_other_room():
    places: list[tuple[float, float]] = []

    class Painter(QPainter):
        def drawText(self, place, *args) -> None:
            places.append((place.left(), place.right()))

    for width in (110, 150, 400):
        places.clear()
        gradient = Gradient()
        gradient.resize(width, 40)
        gradient.low, gradient.high, gradient.beyond = -1.234, 9.06, (True, True)
        canvas = QImage(width, 40, QImage.Format.Format_RGB32)
        with Painter(canvas) as painter:
            gradient._paint(painter)
        places.sort()
        assert places[0][0] >= 0
        assert places[-1][1] <= width + 1
        assert all(after > before for (_, before), (after, _) in itertools.pairwise(places))
        assert len(places) >= (2 if width < 400 else 3)


def indices(row: np.ndarray, cmap: str) -> list[int]:
    """Where in a colour map the colours [n, 3] stand."""
    return [int(np.abs(colour_table(cmap).astype(int) - colour).sum(1).argmin()) for colour in row.astype(int)]


@pytest.mark.parametrize("span", [(0.0, 0.0), (1e-9, 2e-9), (-1e7, 3e8), (5.0, 5.0001)])
def test_odd_ranges_are_painted(bar, span):
    bar.set_range(*span)
    bar.grab()
    gradient = Gradient()
    gradient.low, gradient.high = span
    gradient.grab()


def test_wrong_values_are_refused(bar):
    with pytest.raises(ValueError, match="finite"):
        bar.set_range(0.0, float("nan"))
    with pytest.raises(ValueError, match="mode"):
        bar.set_range_mode("auto")
    with pytest.raises(ValueError, match="jet"):
        bar.set_cmap("jet")
