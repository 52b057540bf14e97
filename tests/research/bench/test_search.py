"""The benchmark of searches over an archive, in its short form."""

from __future__ import annotations

import pytest

from degense.engine.archive.index_file import INDEX
from degense.engine.research.bench.run import BenchOptions, run
from degense.engine.research.benchmarks import search
from tests.layers.conftest import clip, scene  # noqa: F401


def test_search_tables(scene, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.setattr(search, "trained_scene", lambda options, progress: (scene, "a tiny scene"))
    monkeypatch.setattr(search, "FILMS", 2)
    index, asked, commands = run("search", BenchOptions("cpu", (0,), 2, True, tmp_path))
    assert [(row["clips"], row["frames"]) for row in index.rows] == [(2, 200), (4, 400)]
    assert [row.get("power") is None for row in index.rows] == [True, False]
    assert index.rows[-1]["size"] * 2**20 == pytest.approx((tmp_path / "archive" / INDEX).stat().st_size)
    assert [row["question"] for row in asked.rows] == [*search.QUESTIONS]
    assert all(len(row["time"]) == 2 and row["runs"] <= 4 for row in asked.rows)
    by_question = {row["question"]: row for row in asked.rows}
    assert by_question["grasper"]["moments"] >= by_question["grasper"]["runs"] == 4
    assert [len(row["time"]) for row in commands.rows] == [2, 2, 2, 2]
    assert [*(tmp_path / "thumbnails").rglob("*.jpg")], "the command has answered from the simulated index, with pictures"
    assert {path.name for path in (tmp_path / "real").iterdir()} >= {"one", INDEX}
