"""Task: see several layers at once."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QSlider

from degense.app.features.viewer.layer_list import MASKS
from degense.widgets.glyphs import GlyphButton
from tests.app import installed as on


def test_colour_displacement_and_masks_at_once(qtbot, opened, idle, screenshot):
    """By keys: displacement is ticked over the colours, made fainter, and moved below them and back; masks lie on top."""
    session, layers, panel = opened.session, on.layers(opened).layers, on.viewer(opened).panel
    session.go_to(8)
    session.view.add_prompt("liver")
    idle()
    steps, colours = len(session.undo.entries), on.viewer(opened).view.rgb
    layers.rows.setFocus()
    while layers.current() != "displacement":
        QTest.keyClick(layers.rows, Qt.Key.Key_Up)
    QTest.keyClick(layers.rows, Qt.Key.Key_Space)
    idle()
    both = on.viewer(opened).view
    assert session.view_state.layer == both.layer == "displacement"
    assert both.span is not None
    assert on.viewer(opened).bar.isVisible()
    assert both.masks is not None
    slider = layers.findChild(QSlider)
    for _ in range(3):
        QTest.keyClick(slider, Qt.Key.Key_PageDown)
    idle()
    fainter = on.viewer(opened).view.rgb
    session.view.set_layer("displacement")
    idle()
    alone = on.viewer(opened).view
    for shown, opacity in ((both.rgb, 0.6), (fainter, 0.3)):
        expected = alone.rgb.astype(float) * opacity + colours.astype(float) * (1 - opacity)
        assert np.abs(shown - expected).max() <= 1.5
    assert not np.array_equal(both.splats.colours, alone.splats.colours)  # the 3D view blends too
    session.view.set_layer_visible("rgb", True)
    idle()
    assert session.view_state.layer == "rgb"
    assert on.viewer(opened).view.layer == "displacement"  # the bar tells of the numbers that are seen
    screenshot(opened, "blend")
    layers.rows.setFocus()
    for _ in range(5):
        QTest.keyClick(layers.rows, Qt.Key.Key_Up, Qt.KeyboardModifier.AltModifier)
    idle()
    drawn = [blend.name for blend in session.view_state.drawn]
    assert drawn == ["displacement", "rgb"]
    assert len(session.undo.entries) == steps  # looking at layers is no edit
    session.undo.undo()  # the prompt; layers stay
    assert [blend.name for blend in session.view_state.drawn] == drawn
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_1)
    idle()
    assert [blend.name for blend in session.view_state.drawn] == ["rgb"]
    assert np.array_equal(on.viewer(opened).view.rgb, colours)


def test_masks_comparing_and_eyes_are_no_edits_either(opened, idle, screenshot):
    """By keys and mouse: the masks' row and its opacity, `M`, Shift with an arrow, `C`, and the eye of a prompt."""
    session, layers, panel = opened.session, on.layers(opened).layers, on.viewer(opened).panel
    session.view.add_prompt("liver")
    session.view.add_prompt("grasper")
    idle()
    steps, undo = session.undo.entries, opened.menus.actions["edit.undo"]
    layers.rows.setFocus()
    while layers.current() != MASKS:
        QTest.keyClick(layers.rows, Qt.Key.Key_Up)
    QTest.keyClick(layers.rows, Qt.Key.Key_Space)
    assert not session.view_state.masks_shown
    QTest.keyClick(layers.findChild(QSlider), Qt.Key.Key_PageDown)
    panel.setFocus()
    QTest.keyClick(opened.windowHandle(), Qt.Key.Key_Down, Qt.KeyboardModifier.ShiftModifier)
    QTest.keyClick(opened.windowHandle(), Qt.Key.Key_C)
    [eye] = [button for button in on.prompts(opened).bar.findChildren(GlyphButton) if button.accessibleName() == "Hide liver"]
    QTest.mouseClick(eye, Qt.MouseButton.LeftButton)
    idle()
    assert session.undo.entries == steps == ("Prompt liver", "Prompt grasper")
    assert undo.text() == "Undo: Prompt grasper"
    screenshot(opened, "view-switches")

    def seen() -> tuple[object, ...]:
        state = session.view_state
        return state.masks_shown, round(state.overlay_opacity, 2), state.compare, state.prompt("liver").visible

    assert seen() == (False, 0.55, "wipe", False)
    panel.setFocus()
    QTest.keyClick(opened.windowHandle(), Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)  # the prompt goes; the view stays
    assert [prompt.text for prompt in session.view_state.prompts] == ["liver"]
    assert seen() == (False, 0.55, "wipe", False)
    QTest.keyClick(opened.windowHandle(), Qt.Key.Key_M)
    QTest.keyClick(opened.windowHandle(), Qt.Key.Key_Y, Qt.KeyboardModifier.ControlModifier)
    assert [prompt.text for prompt in session.view_state.prompts] == ["liver", "grasper"]
    assert seen() == (True, 0.55, "wipe", False)


def test_the_last_layer_stays(opened, idle):
    layers = on.layers(opened).layers
    layers.rows.item(layers.rows.names().index("rgb")).setCheckState(Qt.CheckState.Unchecked)
    assert [blend.name for blend in opened.session.view_state.drawn] == ["rgb"]
    assert layers.rows.item(layers.rows.names().index("rgb")).checkState() is Qt.CheckState.Checked


def test_layers_are_saved_with_the_session(opened, idle, run):
    view = opened.session.view
    view.set_layer_visible("displacement", True)
    view.set_layer_opacity("displacement", 0.25)
    view.move_layer("displacement", 3)
    idle()
    before = opened.session.view_state
    on.autosave(opened).save()
    idle()
    on.documents(opened).open_path(run)
    idle()
    assert opened.session.view_state.drawn == before.drawn
    assert opened.session.view_state.blend == before.blend


def test_a_layer_that_cannot_be_drawn_is_left_out(opened, idle):
    view = opened.session.view
    view.set_layer_visible("similarity", True)
    view.choose_layer("rgb")
    idle()
    assert on.viewer(opened).view is not None
    assert on.viewer(opened).view.layer == "rgb"
    view.choose_layer("similarity")
    idle()
    assert on.viewer(opened).view is None  # chosen, it says what is missing


@pytest.mark.parametrize("key", ["visible", "opacity", "more"])
def test_damaged_layers_are_refused_and_old_sessions_open(key):
    from degense.app.session.view_state import LAYER_ORDER, ViewState
    from degense.engine.errors import RunError

    old = ViewState(layer="depth").to_json()
    del old["blend"]
    assert ViewState.from_json(old, "old") == ViewState(layer="depth")
    entry = {"name": "depth", "visible": True, "opacity": 7.0}
    state = ViewState.from_json(old | {"blend": [entry, {"name": "gone", "visible": True, "opacity": 0.5}]}, "new")
    assert state.blend[0].opacity == 1.0
    assert {blend.name for blend in state.blend} == {blend.name for blend in LAYER_ORDER}
    damaged = entry | {"more": 1} if key == "more" else {name: value for name, value in entry.items() if name != key}
    with pytest.raises(RunError, match="saved view"):
        ViewState.from_json(old | {"blend": [damaged]}, "damaged")
