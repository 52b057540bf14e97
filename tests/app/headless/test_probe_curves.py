"""Following spots, regions and masks, on splats whose motion is known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.inspect.curves import follow, summary, to_csv
from degense.app.features.inspect.probe_maps import ClassDirections, probe_maps
from degense.app.features.prompts.mask_statistics import AreaCurves, measure_masks
from degense.app.features.viewer.view_rendering import ViewRequest, draw_view
from degense.app.session.targets import Found, Region, Spot, inside_of, material
from degense.app.session.view_state import Prompt, ViewState
from degense.engine.errors import DegenseError, RunError
from degense.engine.scene.uncertainty import is_guess

LOOK = ViewState(prompts=(Prompt("gallbladder", (230, 159, 0)), Prompt("liver", (86, 180, 233))))


def curves_of(scene, place, view_state=LOOK):
    return run_steps(follow(scene, place, view_state), Bar())


def test_the_curve_is_the_motion_of_the_gaussians_there(scene):
    place = Spot(4, 50.0, 40.0)
    curves = curves_of(scene, place)
    indices, weights = material(scene, place)
    assert weights.sum() == pytest.approx(1)
    moved = [scene.states.displacement(index)[indices].numpy() @ weights for index in range(scene.frames)]
    mean, low, high = curves.layers["displacement"]
    assert np.allclose(mean, moved, atol=1e-5)
    assert mean[scene.reference_frame] == 0
    assert ((low <= mean) & (mean <= high)).all()
    assert set(curves.layers) == {"displacement", "speed", "rotation", "scale"}
    assert set(curves.similarity) == {"gallbladder", "liver"}
    rendered = scene.query(4).similarity(scene.included("gallbladder"))[int(place.y), int(place.x)]
    assert curves.similarity["gallbladder"][4] == pytest.approx(rendered, abs=0.15)


def test_a_spot_lies_where_one_clicked(scene):
    indices, weights = material(scene, Spot(2, 30.0, 60.0))
    pixels, _ = scene.camera(2).project(scene.splats(2).means[indices].numpy().astype(float))
    assert np.hypot(*(weights @ pixels - (30, 60))) < 4


def test_a_region_is_followed_as_material(scene):
    outline = ((20.0, 20.0), (60.0, 20.0), (60.0, 50.0), (20.0, 50.0))
    indices, weights = material(scene, Region(4, outline))
    pixels, _ = scene.camera(4).project(scene.splats(4).means[indices].numpy().astype(float))
    assert ((pixels > (19.5, 19.5)) & (pixels < (60.5, 50.5))).all()
    curves = curves_of(scene, Region(4, outline), replace(LOOK, layer="depth"))
    z = scene.camera(7).project(scene.splats(7).means[indices].numpy().astype(float))[1]
    assert curves.layers["depth"][0, 7] == pytest.approx(z @ weights, rel=1e-4)
    moved = scene.states.displacement(7)[indices].numpy()
    assert moved.min() <= curves.layers["displacement"][1, 7] <= np.median(moved) <= curves.layers["displacement"][2, 7] <= moved.max()


def test_inside_of_an_outline_by_its_pixel_middles():
    assert inside_of(((2, 1), (5, 1), (5, 3), (2, 3)), 8, 6).tolist() == [[1 <= y < 3 and 2 <= x < 5 for x in range(8)] for y in range(6)]
    assert not inside_of(((-9, -9), (-5, -9), (-5, -4)), 8, 6).any()


def test_what_a_prompt_finds_is_looked_for_in_each_frame(scene):
    view_state = replace(LOOK, decoder="threshold", layer="depth")
    curves = curves_of(scene, Found("gallbladder"), view_state)
    mask = scene.query(6).similarity(scene.included("gallbladder")) > view_state.threshold
    assert curves.area[6] == pytest.approx(mask.mean())
    assert curves.layers["depth"][0, 6] == pytest.approx(np.nanmean(scene.render(6, what=("depth",))["depth"][mask]), rel=1e-4)
    assert curves.similarity == {}


def test_the_table_names_its_units_and_leaves_gaps_empty(scene):
    curves = curves_of(scene, Found("gallbladder"), replace(LOOK, decoder="threshold", threshold=2.0))  # nothing is found
    head, first, *_ = [line.split(",") for line in to_csv(curves).splitlines()]
    assert head[:2] == ["frame", "displacement mean [mm]"]
    assert head[-1] == "area [share of the picture]"
    assert first[:3] == ["0", "", ""]
    assert first[-1] == "0"


def test_a_summary_is_weighted_and_ignores_what_is_not_known():
    numbers, weights = np.array([1.0, np.nan, 3.0, 100.0]), np.array([1.0, 5.0, 1.0, 0.0])
    assert summary(numbers, weights)[0] == 2.0
    assert np.isnan(summary(numbers[1:2], weights[1:2])).all()


def test_nothing_is_followed_where_nothing_is(scene):
    scene.splats(0).opacities.zero_()
    with pytest.raises(DegenseError, match="Nothing is reconstructed"):
        curves_of(scene, Spot(0, 5, 5), ViewState())


def test_maps_hold_what_the_layers_show(scene):
    steps = probe_maps(scene, 3)
    growing = [len(next(steps).scalars) for _ in range(7)]
    with pytest.raises(StopIteration) as end:
        next(steps)
    maps = end.value.value
    assert growing == [0, 1, 2, 3, 4, 5, 6]
    rows = dict(maps.rows(40, 30))
    depth = scene.render(3, what=("depth",))["depth"][30, 40]
    assert rows["depth"].startswith(f"{depth:.3g}")
    assert set(rows) >= {"position", "colour", "depth", "displacement", "warp", "class 1", "class 5"}


def test_a_view_comes_first_without_and_then_with_masks(scene):
    view_state = ViewState(prompts=(Prompt("gallbladder", (230, 159, 0)),), decoder="threshold")
    steps = draw_view(scene, ViewRequest(3, view_state))
    early = next(steps)
    assert (early.complete, early.masks) == (False, None)
    view = result_of(steps)
    mask = scene.query(3).similarity(scene.included("gallbladder")) > view_state.threshold
    assert np.array_equal(view.masks[..., 3] > 0, mask)
    assert np.array_equal(view.rgb, scene.render_rgb(3))
    assert len(view.splats.colours) == len(scene.splats(3))


def result_of(steps):
    """What a generator returns in the end."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def test_a_guess_is_called_one(scene, monkeypatch):
    """Under the cursor, in the legend's words and in the 3D view: only where the displacement is one."""
    half = np.nanmedian(scene.render(5, what=("uncertainty",))["uncertainty"]) * scene.states.unit
    monkeypatch.setattr("degense.engine.scene.uncertainty.DOUBTFUL", half)
    maps = result_of(probe_maps(scene, 5))
    drawn = scene.render(5, what=("uncertainty", "displacement"))
    guesses = is_guess(drawn["uncertainty"], drawn["displacement"], scene.states.depth)
    for wanted in (True, False):
        y, x = np.argwhere(guesses == wanted)[0]
        assert dict(maps.rows(int(x), int(y)))["displacement"].endswith("(a guess)") == wanted
    request = ViewRequest(5, ViewState(layer="displacement"))
    marked = result_of(draw_view(scene, request))
    assert "guess" in marked.uncertain
    scene.states.observability = None
    plain = result_of(draw_view(scene, request))
    assert plain.uncertain == ""
    assert not np.array_equal(marked.rgb, plain.rgb)
    assert not np.array_equal(marked.splats.colours, plain.splats.colours)


def test_why_a_pixel_is_what_it_is(scene):
    maps = result_of(probe_maps(scene, 3))
    similarity = scene.query(3).similarity(scene.vectors(("gallbladder",)))
    y, x = np.unravel_index(similarity.argmax(), similarity.shape)
    best = maps.why(int(x), int(y))
    assert len(best) == 5
    assert [cosine for _, cosine in best] == sorted((cosine for _, cosine in best), reverse=True)
    assert best[0][0] == "gallbladder"
    assert best[0][1] == pytest.approx(similarity[y, x], abs=0.03)
    assert ClassDirections(scene).best(np.zeros(scene.basis.rank)) == []


def test_answers_know_area_confidence_and_similarities(scene):
    view_state = replace(LOOK, decoder="threshold")
    known = result_of(measure_masks(scene, 3, view_state))
    assert [answer.text for answer in known] == ["gallbladder", "liver"]
    query, meaning = scene.query(3), scene.included("gallbladder")
    mask = query.similarity(meaning) > view_state.threshold
    assert known[0].area == pytest.approx(mask.mean())
    assert known[0].confidence == pytest.approx(query.confidence(meaning, mask, scene.vectors(scene.classes)))
    assert known[0].histogram.sum() == mask.size
    assert known[0].histogram[25:].sum() == pytest.approx(mask.sum(), abs=2)


def test_a_negative_takes_its_pixels(scene):
    """ "Tool" without "hook" leaves the other instruments, and nothing of the hook."""
    from degense.engine.layers import LAYERS, LayerRequest
    from degense.engine.semantics.prompts import PromptSet

    plain = PromptSet(("tool",), decoder="threshold")
    tool, rest = (
        LAYERS["mask"].image(scene, LayerRequest(3, prompt_set=prompts)).values > 0
        for prompts in (plain, replace(plain, negatives=("hook",)))
    )
    hook = scene.query(3).similarity(scene.included("hook"))
    other = scene.query(3).similarity(scene.included("tool")) > hook
    assert np.array_equal(rest, tool & other)
    assert rest.sum() < tool.sum()


def test_areas_are_kept_and_saved_when_whole():
    book, view_state = AreaCurves(), LOOK
    assert book.missing(view_state, 4, around=2) == [2, 1, 3, 0]
    for prompt in view_state.prompts:
        book.curve(prompt.text, view_state, 4)[:] = 0.25
    book.curve("liver", view_state, 4)[3] = np.nan
    assert book.missing(view_state, 4, around=0) == [3]
    assert book.missing(replace(view_state, threshold=0.6), 4, around=0) == [0, 1, 2, 3]
    again = AreaCurves()
    again.from_json(json.loads(json.dumps(book.to_json())), "here")
    assert again.curve("gallbladder", view_state, 4).tolist() == [0.25] * 4
    assert np.isnan(again.curve("liver", view_state, 4)).all()
    for wrong in ([["a"]], [["a", "b", "c", [], []]], 7, [["a", "b", 0.5, [], ["x"]]]):
        with pytest.raises(RunError, match="here"):
            again.from_json(wrong, "here")
