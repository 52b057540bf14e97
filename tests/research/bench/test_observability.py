"""The figures of the benchmark of uncertainty, by hand."""

import numpy as np
import pytest

from degense.engine.research.bench.curves import draw_curves
from degense.engine.research.benchmarks.observability import bounds_table, curve_table, figures, risk


def test_figures_by_hand():
    off = np.array([0.001, 0.002, 0.006, 0.02])
    bound = np.array([0.002, 0.02, 0.005, 0.03])
    found = figures(np.stack([off, bound, np.zeros(4)]))
    assert found["kept"] == 75
    assert found["guesses"] == 50
    assert found["kept_sure"] == 50  # .001 and .006 are sure
    assert found["good_guesses"] == 50  # .001 and .002 are good
    assert found["error_sure"] == pytest.approx(3.5)
    assert found["error_guess"] == pytest.approx(11)
    surest = [0.001, 0.0035, 0.003, 0.00725]
    np.testing.assert_allclose(risk(off, bound), surest)
    best, chance = np.mean([0.001, 0.0015, 0.003, 0.00725]), 0.00725
    assert found["order"] == pytest.approx(100 * (chance - np.mean(surest)) / (chance - best))


def test_the_best_order_is_the_errors_own_and_any_order_ends_at_the_mean():
    off = np.random.default_rng(0).exponential(0.01, 500)
    assert figures(np.stack([off, off, off]))["order"] == pytest.approx(100)
    assert abs(figures(np.stack([off, np.random.default_rng(1).random(500), off]))["order"]) < 20
    rows = curve_table("", np.stack([off, off, off])).rows
    assert [row["share"] for row in rows] == [10 * k for k in range(1, 11)]
    assert rows[-1]["uncertainty"] == pytest.approx(rows[-1]["chance"]) == pytest.approx(rows[-1]["best"])
    assert rows[0]["best"] < rows[0]["chance"]


def test_curves_are_drawn_where_a_table_has_some(tmp_path):
    told = np.random.default_rng(0).random((3, 200)) * 0.01
    assert draw_curves(curve_table("", told), tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 5000
    assert not draw_curves(bounds_table("", [figures(told)]), tmp_path / "b.png")
    assert not (tmp_path / "b.png").exists()
