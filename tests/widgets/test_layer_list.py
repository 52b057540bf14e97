"""Which layers are shown, their order and their opacity."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel, QSlider, QStyle, QStyleOptionViewItem

from degense.app.features.viewer.layer_list import MASKS, LayerList, LayerRow

LAYERS = [("rgb", "Colour", "", "what the camera sees"), ("depth", "Depth", "mm", "camera z"), ("warp", "Warp", "px", "‖model − flow‖")]
ROWS = (LayerRow("rgb", True, 1.0), LayerRow("depth", False, 0.6), LayerRow("warp", True, 0.4))


@pytest.fixture
def layers(show):
    layers = show(LayerList(), 260, 240)
    layers.set_titles(LAYERS)
    layers.set_layers(ROWS, "warp", (True, 0.75))
    return layers


@pytest.fixture
def heard(layers):
    told: list = []
    for name in ("chosen", "shown_alone", "toggled", "opacity_changed", "moved", "masks_toggled", "masks_opacity_changed"):
        getattr(layers, name).connect(lambda *values, name=name: told.append((name, *values)))
    return told


def box(layers, name) -> QPoint:
    """The middle of a row's box."""
    rows = layers.rows
    index = rows.model().index(rows.names().index(name), 0)
    option = QStyleOptionViewItem()
    rows.initViewItemOption(option)
    option.rect = rows.visualRect(index)
    option.features |= QStyleOptionViewItem.ViewItemFeature.HasCheckIndicator
    return rows.style().subElementRect(QStyle.SubElement.SE_ItemViewItemCheckIndicator, option, rows).center()


def click(layers, where: QPoint) -> None:
    QTest.mouseClick(layers.rows.viewport(), Qt.MouseButton.LeftButton, pos=where)


def beside(layers, name) -> QPoint:
    return layers.rows.visualItemRect(layers.rows.item(layers.rows.names().index(name))).center()


def go(layers, name) -> None:
    layers.rows.setFocus()
    layers.rows.setCurrentRow(layers.rows.names().index(name))


def test_the_topmost_comes_first(layers, heard):
    assert layers.rows.names() == [MASKS, "warp", "depth", "rgb"]
    assert [layers.rows.item(row).checkState() is Qt.CheckState.Checked for row in range(4)] == [True, True, False, True]
    assert layers.current() == "warp"
    assert heard == []


def test_a_box_shows_and_a_name_chooses(layers, heard):
    click(layers, box(layers, "depth"))
    click(layers, box(layers, MASKS))
    click(layers, beside(layers, "rgb"))
    assert heard == [("toggled", "depth", True), ("masks_toggled", False), ("chosen", "rgb")]


def test_keys_alone_do(layers, heard):
    go(layers, "warp")
    QTest.keyClick(layers.rows, Qt.Key.Key_Down)
    assert layers.current() == "depth"
    assert heard == []  # nothing that is shown changes by moving through the list
    QTest.keyClick(layers.rows, Qt.Key.Key_Space)
    QTest.keyClick(layers.rows, Qt.Key.Key_Return)
    QTest.keyClick(layers.rows, Qt.Key.Key_Down, Qt.KeyboardModifier.AltModifier)
    go(layers, "warp")
    QTest.keyClick(layers.rows, Qt.Key.Key_Up, Qt.KeyboardModifier.AltModifier)  # above it lie the masks
    assert heard == [("toggled", "depth", True), ("shown_alone", "depth"), ("moved", "depth", 0)]


def test_dragging_moves(layers, heard, qtbot):
    go(layers, "rgb")
    model = layers.rows.model()
    assert model.moveRow(layers.rows.rootIndex(), 3, layers.rows.rootIndex(), 0)  # what a drop does, here above the masks
    qtbot.waitUntil(lambda: bool(heard))
    assert heard == [("moved", "rgb", 2)]


def test_opacity_of_the_current_row(layers, heard):
    slider = layers.findChild(QSlider)
    assert slider.value() == 40
    QTest.keyClick(slider, Qt.Key.Key_PageUp)
    assert heard == [("opacity_changed", "warp", pytest.approx(0.5))]
    go(layers, MASKS)
    assert slider.value() == 75
    QTest.keyClick(slider, Qt.Key.Key_PageUp)
    assert heard[1:] == [("masks_opacity_changed", pytest.approx(0.85))]
    go(layers, "rgb")
    assert not slider.isEnabled()  # the lowest covers everything
    assert any(label.text() == "100 %" for label in layers.findChildren(QLabel))
    assert slider.accessibleName() == "Opacity of Colour"


def test_units_formulas_and_reasons(layers):
    row = layers.rows.names().index("warp")
    assert layers.rows.item(layers.rows.names().index("depth")).text() == "Depth [mm]"
    assert layers.rows.item(row).toolTip() == "‖model − flow‖"
    layers.set_available({"warp": "the clip is gone"})
    assert not layers.rows.item(row).flags() & Qt.ItemFlag.ItemIsEnabled
    assert "the clip is gone" in layers.rows.item(row).toolTip()
    layers.set_available({})
    assert layers.rows.item(row).toolTip() == "‖model − flow‖"


def test_the_row_stays_until_another_layer_is_chosen(layers):
    go(layers, "depth")
    layers.set_layers(ROWS, "warp", (False, 0.5))
    assert layers.current() == "depth"
    layers.set_layers(ROWS, "rgb", (False, 0.5))
    assert layers.current() == "rgb"
