"""Tiles cover every frame at every scale, and what a model says of them lands where it belongs."""

import cv2
import numpy as np
import pytest

from degense.engine.semantics.models.vlm_models import tiled


def mean_colours(pictures):
    """A model whose answer is known: the mean colour of each of 8 × 8 patches, twice."""
    small = np.stack([cv2.resize(picture, (8, 8), interpolation=cv2.INTER_AREA) for picture in pictures]).astype(np.float32)
    return np.concatenate([small, small], -1)


@pytest.mark.parametrize("size", [(64, 64), (48, 80), (90, 31)])
@pytest.mark.parametrize("scales", [1, 2, 3])
def test_the_map_shows_the_frame(size, scales):
    y, x = np.mgrid[: size[0], : size[1]]
    frame = np.stack([255 * y / size[0], 255 * x / size[1], 128 + 0 * x], -1).astype(np.uint8)
    said = tiled(frame, 32, scales, mean_colours)
    rows, columns = said.shape[:2]
    assert min(rows, columns) == pytest.approx(8 * scales, abs=1)
    assert rows / columns == pytest.approx(size[0] / size[1], rel=0.1)
    expected = cv2.resize(frame, (columns, rows), interpolation=cv2.INTER_AREA).astype(np.float32)
    assert np.abs(said[..., :3] - expected).max() < 255 / (8 * scales) + 20 / scales
    assert np.abs(said[..., :3] - expected).mean() < 8
    np.testing.assert_array_equal(said[..., :3], said[..., 3:])
