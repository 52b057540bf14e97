"""Task: see how far tissue moved, and where it moved without reason."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.colour_maps import colourise, hatched
from tests.app import installed as on


@pytest.mark.parametrize(("key", "layer", "unit"), [("6", "displacement", "mm"), ("7", "warp", "px")])
def test_a_heatmap_by_its_key(qtbot, opened, idle, screenshot, key, layer, unit):
    scene = opened.session.scene
    opened.session.go_to(8)
    on.viewer(opened).panel.setFocus()
    qtbot.keyClicks(on.viewer(opened).panel, key)
    idle()
    view = on.viewer(opened).view
    assert opened.session.view_state.layer == layer
    assert on.layers(opened).layers.current() == layer
    assert view.unit == (scene.unit if unit == "mm" else unit)
    from degense.engine.layers import LAYERS, LayerRequest, layer_range

    whole = layer_range(scene, LAYERS[layer], LayerRequest(8), "sequence")
    assert view.span == whole == on.layers(opened).colour_bar.range()
    image = LAYERS[layer].image(scene, LayerRequest(8))
    assert image.uncertain.any()
    assert np.array_equal(view.rgb, hatched(colourise(image.values, LAYERS[layer].cmap, *whole), image.uncertain))
    assert "hatched" in view.uncertain  # the legend's words
    assert on.layers(opened).colour_bar.isVisible()
    screenshot(opened, layer)


def test_range_of_the_frame_the_sequence_and_fixed(opened, idle):
    session, bar = opened.session, on.layers(opened).colour_bar
    session.view.set_layer("displacement")
    session.go_to(2)
    idle()
    whole = on.viewer(opened).view.span
    bar.changed.emit({"mode": "frame"})
    idle()
    assert on.viewer(opened).view.span[1] < whole[1]
    assert bar.range_mode() == "frame"
    bar.changed.emit({"mode": "fixed", "low": 0.0, "high": 123.0})
    session.go_to(9)
    idle()
    assert on.viewer(opened).view.span == bar.range() == (0.0, 123.0)
    session.view.set_layer("depth")
    idle()
    assert bar.range_mode() == "sequence"  # each layer has a range of its own
    session.view.set_layer("displacement")
    idle()
    assert on.viewer(opened).view.span == (0.0, 123.0)
    session.undo.undo()
    idle()


def test_another_colour_map_is_used_in_both_views(opened, idle):
    opened.session.view.set_layer("depth")
    idle()
    before = on.viewer(opened).view
    on.layers(opened).colour_bar.changed.emit({"cmap": "magma"})
    idle()
    after = on.viewer(opened).view
    assert not np.array_equal(before.rgb, after.rgb)
    assert not np.array_equal(before.splats.colours, after.splats.colours)
    assert on.layers(opened).colour_bar.cmap() == "magma"


def test_a_layer_without_its_prompt_says_so(opened, idle):
    opened.session.view.set_layer("similarity")
    idle()
    assert on.viewer(opened).view is None
    opened.session.view.add_prompt("liver")
    idle()
    assert on.viewer(opened).view.unit == "cosine"
    assert on.viewer(opened).view.span == (0.0, 1.0)
