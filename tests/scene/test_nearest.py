"""The nearest places, against scipy's k-d tree and by hand."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from degense.engine.scene.nearest import nearest


@pytest.mark.parametrize(("dimensions", "count"), [(3, 32), (2, 128)])
def test_they_are_those_of_another_tree(dimensions, count):
    rng = np.random.default_rng(dimensions)
    places, queries = (rng.normal(size=(n, dimensions)).astype(np.float32) for n in (3000, 500))
    rows, distances = nearest(places, queries, count)
    wanted, expected = cKDTree(places.astype(float)).query(queries.astype(float), count)
    assert rows.dtype == np.int64
    assert (rows == expected).mean() > 0.999  # but where two are equally far to the precision of float32
    np.testing.assert_allclose(distances, wanted, atol=1e-5)


def test_there_are_no_more_than_there_are():
    rows, distances = nearest(np.array([[0.0, 0], [3, 4]]), np.array([[0.0, 0]]), 5)
    assert rows.tolist() == [[0, 1]]
    assert distances.tolist() == [[0, 5]]
