"""Change of appearance: CIELAB by hand, and on a run whose tissue is burnt in places that are known."""

import numpy as np
import pytest
from skimage.color import rgb2lab

from degense.engine.layers import LAYERS, LayerRequest
from degense.engine.layers.appearance import colour_difference


def test_the_difference_is_the_distance_in_cielab():
    here, there = np.random.default_rng(0).random((2, 6, 5, 3)).astype(np.float32)
    np.testing.assert_allclose(colour_difference(here, there), np.linalg.norm(rgb2lab(here) - rgb2lab(there), axis=-1), rtol=0.03, atol=0.5)
    black, white = np.zeros((1, 1, 3)), np.ones((1, 1, 3))
    assert colour_difference(black, white)[0, 0] == pytest.approx(100, abs=0.1)


def test_burnt_tissue_stands_out_and_the_rest_does_not(scene, clip):
    layer, truth = LAYERS["appearance"], clip.truth()
    changed, others = [], []
    for frame in range(len(clip)):
        values = layer.image(scene, LayerRequest(frame)).values
        tissue = np.isfinite(truth.displacement[frame]).all(-1) & np.isfinite(values)
        changed.append(values[tissue & truth.cautery[frame]])
        others.append(values[tissue & ~truth.cautery[frame]])
    assert np.median(np.concatenate(changed)) > 2 * np.median(np.concatenate(others))


def test_nothing_has_changed_at_the_reference_frame_on_tissue(scene):
    splats = LAYERS["appearance"].splats(scene, LayerRequest(scene.reference_frame))
    assert splats.shape == (len(scene.model),)
    assert splats.max() == 0
    before = scene.render(scene.reference_frame, None, ("before",))["before"]
    assert before.shape == (*scene.clip_size[::-1], 3)
