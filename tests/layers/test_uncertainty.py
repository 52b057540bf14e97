"""The uncertainty of displacement on a small run with exact truth."""

import numpy as np

from degense.engine.research.benchmarks.observability import errors


def test_uncertainty_is_measured_against_the_truth_as_shares_of_the_depth(scene, clip):
    off, bound, moved = errors(scene, clip)
    depth, right = np.median(clip.depth(0)[clip.valid(0)]), np.linalg.norm(clip.truth().displacement[3].astype(float), axis=-1)
    drawn = scene.render(3, None, ("displacement", "uncertainty"))
    counted = np.isfinite(right) & clip.valid(3) & np.isfinite(drawn["displacement"])
    count = np.count_nonzero(counted)
    np.testing.assert_allclose(off[:count], np.abs(drawn["displacement"] - right)[counted] / depth, rtol=0.05, atol=1e-6)
    np.testing.assert_allclose(moved[:count], drawn["displacement"][counted] / depth, rtol=0.05, atol=1e-6)
    np.testing.assert_allclose(bound[:count], drawn["uncertainty"][counted] / depth, rtol=0.05, atol=1e-6)
