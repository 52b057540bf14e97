"""Task: read values under the pointer, and follow a spot through time."""

from __future__ import annotations

import numpy as np

from degense.app.session.targets import Spot, material
from tests.app import installed as on


def rows(window) -> dict[str, str]:
    return dict(on.probe(window)._maps.rows(*on.probe(window)._cursor))


def test_hovering_reads_values(opened, idle):
    on.viewer(opened).panel.hovered.emit(40, 30)
    idle()
    scene = opened.session.scene
    depth = scene.render(0, what=("depth",))["depth"][30, 40]
    assert rows(opened)["depth"] == f"{depth:.3g} {scene.unit}"
    assert rows(opened)["displacement"].startswith("0 ")
    opened.session.go_to(5)
    idle()
    assert on.probe(opened)._maps.frame == 5
    on.viewer(opened).panel.hovered.emit(-1, -1)


def test_clicking_follows_the_spot(opened, idle, screenshot):
    session = opened.session
    session.go_to(8)
    session.view.add_prompt("gallbladder")
    idle()
    on.viewer(opened).panel.clicked.emit(48, 40)
    idle()
    indices, weights = material(session.scene, Spot(8, 48.5, 40.5))
    moved = [session.scene.states.displacement(frame)[indices].numpy() @ weights for frame in range(10)]
    assert on.probe(opened).panel.similarity.series_names() == ["gallbladder"]
    assert on.probe(opened).panel.similarity.isVisible()
    curves = on.probe(opened).curves
    assert np.allclose(curves.layers["displacement"][0], moved, atol=1e-5)
    screenshot(opened, "probe")
    on.probe(opened).panel.frame_clicked.emit(2)
    assert session.frame == 2
    session.view.add_prompt("liver")
    idle()
    assert set(on.probe(opened).curves.similarity) == {"gallbladder", "liver"}
    assert np.allclose(on.probe(opened).curves.layers["displacement"][0], moved, atol=1e-5)  # still the spot of frame 8
    on.probe(opened).panel.unpin_requested.emit()
    assert session.probe is None
    assert not on.probe(opened).panel.similarity.isVisible()


def test_the_next_click_cancels_the_last(opened, idle):
    on.viewer(opened).panel.clicked.emit(10, 60)
    on.viewer(opened).panel.clicked.emit(70, 50)
    idle()
    assert on.probe(opened).curves.where == "spot at (70, 50) of frame 0"


def test_a_click_on_a_splat_is_a_click_on_its_pixel(opened, idle):
    scene = opened.session.scene
    pixels, _ = scene.camera(0).project(scene.splats(0).means.numpy().astype(float))
    index = int(np.argmin(np.hypot(*(pixels - (48, 40)).T)))
    on.viewer(opened).splats.picked.emit(index)
    assert np.allclose((opened.session.probe.x, opened.session.probe.y), pixels[index])
    idle()
