"""Numbers along an axis."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import colormaps

from degense.engine.colour_maps import colour_table
from degense.widgets.numbers import ticks


@pytest.mark.parametrize(("low", "high"), [(0.0, 9.06), (-3.0, 3.0), (1e-9, 2e-9), (-1e7, 3e8), (5.0, 5.0001), (0.2, 0.9)])
@pytest.mark.parametrize("most", [2, 4, 9])
def test_ticks_are_few_round_and_inside(low, high, most):
    found = ticks(low, high, most)
    assert 1 <= len(found) <= most + 1
    assert low - 1e-9 * (high - low) <= found[0]
    assert found[-1] <= high + 1e-9 * (high - low)
    if len(found) > 1:
        step = found[1] - found[0]
        assert np.allclose(np.diff(found), step)
        assert f"{step:e}"[0] in "1259"  # 9.99…


def test_no_ticks_where_there_is_no_range():
    assert ticks(1.0, 1.0, 4) == []
    assert ticks(0.0, float("inf"), 4) == []


@pytest.mark.parametrize("name", ["viridis", "cividis", "magma"])
def test_colours_are_those_of_matplotlib(name):
    assert np.array_equal(colour_table(name), (colormaps[name](np.arange(256))[:, :3] * 255).round().astype(np.uint8))
