"""Run time against error, drawn."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from degense.engine.research.bench.plot import Point, draw_pareto, pareto_front, points_of
from degense.engine.research.bench.table import Column, Table


def table(points: list[tuple[str, float | list[float] | None, float | None]]) -> Table:
    columns = [Column("name", "name"), Column("time", "time, ms"), Column("error", "error")]
    rows = [{"name": name, "time": time, "error": error} for name, time, error in points]
    return Table("x", "Everything × against Σ", "Once.", columns, rows, pareto=("time", "error"), hardware="here", date="today")


def test_the_front_is_what_nothing_beats():
    random = np.random.default_rng(5)
    values = random.integers(1, 12, (60, 2)).astype(float)
    points = [Point(str(i), (t, t, t), (e, e, e)) for i, (t, e) in enumerate(values)]
    front = {(p.time[0], p.error[0]) for p in pareto_front(points)}
    beaten = [any((o <= v).all() and (o < v).any() for o in values) for v in values]
    assert front == {tuple(v) for v, lost in zip(values, beaten, strict=True) if not lost}


def test_rows_without_both_figures_are_left_out():
    made = table([("a", [1.0, 3.0, 2.0], 0.5), ("b", None, 1.0), ("c", 1.0, None), ("d", 0.0, 1.0)])
    assert points_of(made) == [Point("a", (2.0, 1.0, 3.0), (0.5, 0.5, 0.5))]


@pytest.mark.parametrize(
    "points",
    [
        [("a", 1.0, 0.5), ("b", 2.0, 0.4)],
        [("exact", 900.0, 0.0), ("float32", 0.5, 3e-7), ("half", 0.4, 0.1)],
        [("tiny", 1.0, 1e-6), ("large", 2.0, 1e3)],
        [("same", 1.0, 1.0), ("same again", 1.0, 1.0)],
        [(f"row {i} with a long name", [1.0 + 0.01 * i, 1.1 + 0.01 * i], 1.0 + 0.001 * i) for i in range(20)],
        [("below zero", 1.0, -2.0), ("above", 3.0, 100.0)],
    ],
)
def test_a_plot_is_drawn(points, tmp_path):
    path = tmp_path / "plot.png"
    assert draw_pareto(table(points), path)
    picture = cv2.imread(str(path))
    assert picture.shape[:2] == (780, 1230)
    assert (picture[:5] == 255).all()  # a light background
    assert (picture < 128).any(2).sum() > 2000  # with something on it


def test_one_point_is_no_plot(tmp_path):
    assert not draw_pareto(table([("a", 1.0, 1.0)]), tmp_path / "plot.png")
    assert not list(tmp_path.iterdir())
