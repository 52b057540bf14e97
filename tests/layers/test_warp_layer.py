"""The warp layer on a tiny real run: where it is zero, unknown and hatched, and how far its colours reach."""

from dataclasses import replace

import numpy as np

from degense.engine.layers import LAYERS, LayerRequest, layer_range

SIDE = 5


def test_warp_is_zero_at_the_reference_and_unknown_before_evidence(scene, clip):
    layer = LAYERS["warp"]
    start = layer.image(scene, LayerRequest(scene.reference_frame)).values
    assert np.nanmax(start) == 0
    values = layer.image(scene, LayerRequest(SIDE)).values
    _, seen, spread = scene.observed_motion.at(SIDE)
    assert np.isnan(values[np.isnan(spread)]).all()
    assert np.isfinite(values[np.isfinite(spread)]).mean() > 0.9
    uncertain = layer.image(scene, LayerRequest(SIDE)).uncertain
    assert not uncertain[seen].any()
    assert np.array_equal(uncertain, ~seen & np.isfinite(spread))
    assert np.nanmin(values) >= 0
    splats = layer.splats(scene, LayerRequest(SIDE))
    known = np.isfinite(splats)
    assert known.any()
    assert np.isin(splats[known], values).all()


def test_warp_that_is_error_of_the_measurement_stays_dark(scene):
    low, high = layer_range(scene, LAYERS["warp"], LayerRequest(scene.reference_frame), "frame")
    assert (low, high) == (0.0, 3.0)
    large = replace(LAYERS["warp"], pixels=lambda scene, request: np.linspace(0, 20, 50).reshape(5, 10))
    assert layer_range(scene, large, LayerRequest(SIDE), "frame")[1] > 19
