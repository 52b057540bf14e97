"""Superpixels keep to edges and cover every picture."""

import numpy as np
import pytest

from degense.engine.semantics.masks.superpixels import superpixels
from tests.semantics.masks.scenes import scene


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (7, 5), (13, 200), (64, 64)])
def test_every_number_occurs_whatever_the_size(shape):
    rgb = np.random.default_rng(0).integers(0, 256, (*shape, 3)).astype(np.uint8)
    regions = superpixels(rgb)
    assert regions.shape == shape
    assert regions.dtype == np.int32
    np.testing.assert_array_equal(np.unique(regions), np.arange(regions.max() + 1))


def test_a_constant_picture_becomes_a_grid():
    regions = superpixels(np.full((96, 120, 3), 77, np.uint8), region_size=12)
    assert regions.max() + 1 == 80
    assert np.bincount(regions.ravel()).max() <= 2 * 144


def test_regions_keep_to_label_edges():
    rgb, labels = scene(320, 256, seed=4)
    regions = superpixels(rgb)
    votes = np.zeros((regions.max() + 1, 4))
    np.add.at(votes, (regions.ravel(), labels.ravel()), 1)
    assert votes.max(1).sum() / labels.size > 0.985
    # a grid of the same size does worse: the regions follow the picture, they are not just small
    rows, columns = np.mgrid[:256, :320]
    grid = rows // 12 * 27 + columns // 12
    votes_grid = np.zeros((grid.max() + 1, 4))
    np.add.at(votes_grid, (grid.ravel(), labels.ravel()), 1)
    assert votes.max(1).sum() > votes_grid.max(1).sum() + 0.005 * labels.size


def test_two_flat_halves_are_never_mixed():
    rgb = np.zeros((60, 61, 3), np.uint8)
    rgb[:, 31:] = 220
    regions = superpixels(rgb)
    # the 3 × 3 smoothing may tint the column on either side of the edge
    assert not set(regions[:, :30].ravel()) & set(regions[:, 32:].ravel())


def test_the_same_picture_gives_the_same_regions():
    rgb, _ = scene(160, 128)
    np.testing.assert_array_equal(superpixels(rgb), superpixels(rgb.copy()))


def test_region_size_is_checked():
    with pytest.raises(ValueError, match="at least 1"):
        superpixels(np.zeros((4, 4, 3), np.uint8), region_size=0)
