"""Choosing layers and the strength of masks."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QCheckBox, QRadioButton, QSlider

from degense.app.features.viewer.layer_list import LayerList

LAYERS = [("rgb", "Colour", "", "what the camera sees"), ("depth", "Depth", "mm", "camera z"), ("warp", "Warp", "px", "‖model − flow‖")]


@pytest.fixture
def layers(show):
    layers = show(LayerList(), 260, 240)
    layers.set_layers(LAYERS)
    return layers


def button(layers, start):
    return next(b for b in layers.findChildren(QRadioButton) if b.text().startswith(start) and not b.isHidden())


def click(button):
    QTest.mouseClick(button, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, QPoint(8, button.height() // 2))


def test_choosing(layers):
    heard: list = []
    layers.layer_changed.connect(heard.append)
    assert layers.current() == "rgb"
    layers.set_current("depth")
    assert heard == []
    click(button(layers, "Warp"))
    assert heard == ["warp"]
    assert layers.current() == "warp"
    with pytest.raises(ValueError, match="smell"):
        layers.set_current("smell")


def test_keys_choose_too(layers):
    heard: list = []
    layers.layer_changed.connect(heard.append)
    button(layers, "Colour").setFocus()
    QTest.keyClick(button(layers, "Colour"), Qt.Key.Key_Down)
    assert layers.current() == "depth"
    assert heard == ["depth"]


def test_units_formulas_and_reasons(layers):
    assert button(layers, "Depth").text() == "Depth  [mm]"
    assert button(layers, "Warp").toolTip() == "‖model − flow‖"
    layers.set_available("warp", False, "the clip is gone")
    assert not button(layers, "Warp").isEnabled()
    assert "the clip is gone" in button(layers, "Warp").toolTip()
    layers.set_available("warp", True)
    assert button(layers, "Warp").toolTip() == "‖model − flow‖"


def test_other_layers_keep_the_choice(layers):
    layers.set_current("depth")
    layers.set_layers(LAYERS[1:])
    assert layers.current() == "depth"
    layers.set_layers(LAYERS[2:])
    assert layers.current() == "warp"
    layers.set_layers([])
    assert layers.current() == ""


def test_masks_and_opacity(layers):
    opacities: list = []
    shown: list = []
    layers.opacity_changed.connect(opacities.append)
    layers.masks_toggled.connect(shown.append)
    layers.set_opacity(0.4)
    layers.set_masks_shown(False)
    assert (opacities, shown) == ([], [])
    assert layers.findChild(QSlider).value() == 40
    assert not layers.findChild(QCheckBox).isChecked()
    QTest.keyClick(layers.findChild(QSlider), Qt.Key.Key_PageUp)
    assert opacities == [pytest.approx(0.5)]
    click(layers.findChild(QCheckBox))
    assert shown == [True]
