"""Task: read values under the pointer, and follow a spot through time."""

from __future__ import annotations

import numpy as np

from degense.app.session.targets import Region, Spot, material
from degense.widgets import forms
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
    opened.docks.bring(on.dock(opened, "Curves"))
    on.viewer(opened).panel.clicked.emit(48, 40)
    idle()
    indices, weights = material(session.scene, Spot(8, 48.5, 40.5))
    moved = [session.scene.states.displacement(frame)[indices].numpy() @ weights for frame in range(10)]
    assert list(on.probe(opened).panel.similarity.series) == ["gallbladder"]
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
    assert opened.statusBar().currentMessage().startswith("Displacement here: 0 ")  # the drawer is closed


def shown(window) -> dict[str, str]:
    return {row[0]: row[1] for row in forms.texts(on.probe(window).panel._table)}


def test_the_numbers_belong_to_the_heading(qtbot, opened, idle, screenshot):
    """Another place on the same frame, a pointer elsewhere, a region: never the numbers of one under the name of another."""
    session, viewer, probe = opened.session, on.viewer(opened), on.probe(opened)
    depth = session.scene.render(0, what=("depth",))["depth"]
    for x, y in ((20, 30), (70, 50)):
        session.probe = Spot(0, x + 0.5, y + 0.5)
        assert probe.panel._place.text() == f"spot at ({x + 0.5:.0f}, {y + 0.5:.0f}) of frame 0"
        idle()
        viewer.panel.hovered.emit(5, 5)
        assert shown(opened)["position"] == f"{x}, {y} px"
        assert shown(opened)["depth"].split()[0] == f"{depth[y, x]:.3g}"
    session.probe = Region(0, ((10.0, 10.0), (50.0, 10.0), (50.0, 50.0), (10.0, 50.0)))
    assert shown(opened) == {}
    session.go_to(7)
    idle()
    assert shown(opened)["displacement"].split()[0] == f"{probe.curves.layers['displacement'][0, 7]:.3g}"
    assert "position" not in shown(opened)
    screenshot(opened, "probe-region")
    session.probe = None
    idle()
    assert shown(opened)["position"] == "5, 5 px"
    assert probe.panel._place.text() == "Under the pointer"
    viewer.panel.hovered.emit(-1, -1)


def test_a_click_on_a_splat_is_a_click_on_its_pixel(opened, idle):
    scene = opened.session.scene
    pixels, _ = scene.camera(0).project(scene.splats(0).means.numpy().astype(float))
    index = int(np.argmin(np.hypot(*(pixels - (48, 40)).T)))
    on.viewer(opened).splats.picked.emit(index)
    assert np.allclose((opened.session.probe.x, opened.session.probe.y), pixels[index])
    idle()
