"""Following a spot, on splats whose motion is known."""

from __future__ import annotations

import numpy as np
import pytest

from app.look import Look, Prompt
from app.probe import follow, probe_maps, spot
from app.terminal import Bar, run_steps
from app.view import ViewRequest, draw_view
from engine.errors import DegenseError


def test_the_curve_is_the_motion_of_the_gaussians_there(scene):
    frame, x, y = 4, 50.0, 40.0
    curves = run_steps(follow(scene, frame, x, y, ("gallbladder", "liver")), Bar())
    indices, weights = spot(scene, frame, x, y)
    assert weights.sum() == pytest.approx(1)
    moved = [scene.displacement(index)[indices].numpy() @ weights for index in range(scene.frames)]
    assert np.allclose(curves.displacement, moved, atol=1e-5)
    assert curves.displacement[scene.reference_frame] == 0
    assert set(curves.similarity) == {"gallbladder", "liver"}
    rendered = scene.query(frame).similarity(scene.meanings("gallbladder"))[int(y), int(x)]
    assert curves.similarity["gallbladder"][frame] == pytest.approx(rendered, abs=0.15)


def test_a_spot_lies_where_one_clicked(scene):
    indices, weights = spot(scene, 2, 30.0, 60.0)
    pixels, _ = scene.camera(2).project(scene.splats(2).means[indices].numpy().astype(float))
    assert np.hypot(*(weights @ pixels - (30, 60))) < 4


def test_nothing_is_followed_where_nothing_is(scene):
    scene.splats(0).opacities.zero_()
    with pytest.raises(DegenseError, match="Nothing is reconstructed"):
        run_steps(follow(scene, 0, 5, 5, ()), Bar())


def test_maps_hold_what_the_layers_show(scene):
    steps = probe_maps(scene, 3)
    growing = [len(next(steps).scalars) for _ in range(4)]
    with pytest.raises(StopIteration) as end:
        next(steps)
    maps = end.value.value
    assert growing == [0, 1, 2, 3]
    rows = dict(maps.rows(40, 30))
    depth = scene.render(3, what=("depth",))["depth"][30, 40]
    assert rows["depth"].startswith(f"{depth:.3g}")
    assert set(rows) >= {"position", "colour", "depth", "displacement", "warp", "best class"}


def test_a_view_comes_first_without_and_then_with_masks(scene):
    look = Look(prompts=(Prompt("gallbladder", (230, 159, 0)),), decoder="threshold")
    steps = draw_view(scene, ViewRequest(3, look))
    early = next(steps)
    assert (early.complete, early.masks) == (False, None)
    with pytest.raises(StopIteration) as end:
        next(steps)
    view = end.value.value
    mask = scene.query(3).similarity(scene.meanings("gallbladder")) > look.threshold
    assert np.array_equal(view.masks[..., 3] > 0, mask)
    assert np.array_equal(view.rgb, scene.picture(3))
    assert len(view.splats.colours) == len(scene.splats(3))


def result_of(steps):
    """What a generator returns in the end."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def test_a_guess_is_called_one(scene):
    """Under the cursor, in the legend's words and in the 3D view: only where the recording does not reveal the motion."""
    maps = result_of(probe_maps(scene, 5))
    guesses = scene.render(5, what=("support",))["support"] < 0.5
    for wanted in (True, False):
        y, x = np.argwhere(guesses == wanted)[0]
        assert dict(maps.rows(int(x), int(y)))["displacement"].endswith("(a guess)") == wanted
    request = ViewRequest(5, Look(layer="displacement"))
    marked = result_of(draw_view(scene, request))
    assert "guess" in marked.uncertain
    scene.support = None
    plain = result_of(draw_view(scene, request))
    assert plain.uncertain == ""
    assert not np.array_equal(marked.rgb, plain.rgb)
    assert not np.array_equal(marked.splats.colours, plain.splats.colours)
