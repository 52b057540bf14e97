"""Speed, turn and growth of Gaussians, against motions whose answer is known; and where they are worst."""

import numpy as np
import pytest
import torch

from degense.engine.errors import DegenseError
from degense.engine.layers import LAYERS, LayerRequest, layer_range
from degense.engine.layers.kinematics import growths, speeds, turns
from degense.engine.layers.ranking import Finding, apart, places, rank


def test_speed_of_a_straight_flight():
    before = torch.zeros(3, 3)
    after = torch.tensor([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    assert speeds(before, after, 0.5).tolist() == [10.0, 0.0, 2.0]
    assert speeds(before, after, 0.0).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("degrees", [0.0, 0.001, 1.0, 90.0, 179.0, 180.0])
def test_the_angle_of_a_turn_whatever_the_pose_length_and_sign(degrees):
    random = np.random.default_rng(1)
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    half = np.radians(degrees) / 2
    turn = np.array([np.cos(half), *np.sin(half) * axis])
    start = random.normal(size=4)
    w, x, y, z = turn
    matrix = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    here, there = torch.tensor(-3.0 * (matrix @ start))[None], torch.tensor(start)[None]
    assert turns(here, there).item() == pytest.approx(degrees, abs=1e-6)


def test_growth_counts_doublings_of_the_volume():
    reference = torch.tensor([[1.0, 2.0, 4.0]]).repeat(3, 1)
    scales = torch.tensor([[2.0, 2.0, 4.0], [1.0, 1.0, 4.0], [4.0, 2.0, 1.0]])
    assert growths(scales, reference).tolist() == [1.0, -1.0, 0.0]


def test_layers_are_nothing_at_the_reference_and_follow_the_splats(scene):
    start, later = LayerRequest(scene.reference_frame), LayerRequest(5)
    for name in ("rotation", "scale"):
        assert np.nanmax(np.abs(LAYERS[name].image(scene, start).values)) < 1e-4
        assert LAYERS[name].image(scene, start).uncertain is None
    expected = (scene.states.advected_means(6) - scene.states.advected_means(4)).norm(dim=1).numpy() * scene.fps / 2
    np.testing.assert_allclose(LAYERS["speed"].splats(scene, later), expected, rtol=1e-5)
    for name in ("speed", "rotation", "scale"):
        image, values = LAYERS[name].image(scene, later), LAYERS[name].splats(scene, later)
        known = image.values[np.isfinite(image.values)]
        assert np.ptp(known) > 0
        assert values.min() - 1e-3 <= known.min() <= known.max() <= values.max() + 1e-3  # a blend is a mean
        assert 0 < image.uncertain.mean() < 1


def test_a_signed_range_is_symmetric_and_the_clip_widens_it(scene):
    layer, here = LAYERS["scale"], LayerRequest(5)
    low, high = layer_range(scene, layer, here, "frame")
    assert -low == high == pytest.approx(np.nanpercentile(np.abs(layer.image(scene, here).values), 99))
    everything = layer_range(scene, layer, here, "frame", clip=0)
    assert everything[1] == pytest.approx(np.nanmax(np.abs(layer.image(scene, here).values)))
    assert layer_range(scene, LAYERS["speed"], here, "frame", clip=10)[1] < layer_range(scene, LAYERS["speed"], here, "frame")[1]
    with pytest.raises(ValueError, match="0 to 50"):
        layer_range(scene, layer, here, "frame", clip=50)


def test_places_are_means_over_what_is_known():
    values = np.zeros((60, 96), np.float32)
    values[20:30, 40:50] = -2.0
    values[50:58, 80:90] = 1.0
    values[:, :10] = np.nan
    values[5, 60] = 40.0  # one stray pixel
    values[40, 5] = 1000.0  # alone in what is not known
    found = places(values)
    by_place = {(round(x, -1), round(y, -1)): value for x, y, value in found}
    assert [round(abs(value), 3) for *_, value in found] == sorted((round(abs(value), 3) for *_, value in found), reverse=True)
    assert by_place[(40.0, 20.0)] == -2.0 or min(value for *_, value in found) == -2.0
    assert max(value for *_, value in found) < 3  # the stray pixel is 40 / 25
    assert places(np.full((20, 30), np.nan, np.float32)) == []


def test_near_a_worse_finding_a_lesser_one_is_left_out():
    findings = [Finding(3, 10, 10, 1.0), Finding(4, 12, 10, -5.0), Finding(30, 11, 10, 2.0), Finding(4, 60, 10, 0.5)]
    assert apart(findings, 8.0) == [findings[1], findings[2], findings[3]]


def test_the_worst_frames_of_a_layer(scene):
    layer = LAYERS["displacement"]
    steps = list(rank(scene, layer, LayerRequest(0)))
    assert [step.done for step in steps] == list(range(1, scene.frames + 1))
    ranking = steps[-1]
    assert [abs(finding.value) for finding in ranking.frames] == sorted((abs(finding.value) for finding in ranking.frames), reverse=True)
    worst = ranking.frames[0]
    image = layer.image(scene, LayerRequest(worst.frame))
    known = image.values[np.isfinite(image.values) & ~image.uncertain]
    assert worst.value == pytest.approx(np.percentile(known, 99))
    assert ranking.places[0].frame in {finding.frame for finding in ranking.frames}
    with pytest.raises(DegenseError, match="layer of motion"):
        next(rank(scene, LAYERS["depth"], LayerRequest(0)))
