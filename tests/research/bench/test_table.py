"""What a table says and keeps."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from degense.engine.research.bench.table import Column, Table


def table(**changes) -> Table:
    values = {
        "name": "speed",
        "title": "Speed",
        "protocol": "Once.",
        "columns": [Column("what", "what"), Column("time", "time, ms", 1), Column("score", "score", 2, "mean")],
        "rows": [{"what": "a", "time": [3.0, 1.0, 2.0], "score": [1.0, 2.0, 6.0]}, {"what": "b", "time": None, "score": 7}],
    }
    return Table(**(values | changes))


@pytest.mark.parametrize(
    ("cell", "middle", "text"),
    [
        ([3.0, 1.0, 2.0], "median", "2.00 (1.00–3.00)"),
        ([1.0, 2.0, 6.0], "mean", "3.00 (1.00–6.00)"),
        ([1234.5], "median", "1,234.50"),
        ([], "median", "–"),
        (None, "median", "–"),
        ("words", "median", "words"),
        (30_000, "median", "30,000"),
        (np.int64(30_000), "median", "30,000"),
        (0.0, "median", "0.00"),
        (0.0004, "median", "4.0e-04"),
        ([0.0004, 0.0002], "median", "3.0e-04 (2.0e-04–4.0e-04)"),
    ],
)
def test_a_cell_in_words(cell, middle, text):
    assert Column("x", "x", 2, middle).text(cell) == text


def test_markdown_keeps_its_cells_apart():
    made = table(rows=[{"what": "a|b\nc <i>", "time": 1.0}]).markdown()
    assert made.splitlines()[2] == "| a\\|b c &lt;i> | 1.0 | – |"


def test_json_and_back():
    before = table(pareto=("time", "score"), notes="Faster.", bench="raster", device="cpu", number=2)
    assert Table.from_json(json.loads(json.dumps(before.to_json(), allow_nan=False))) == before


def test_what_json_cannot_hold_becomes_words():
    rows = [{"what": "a", "time": math.inf, "score": [1.0, math.nan]}, {"what": "b", "time": np.float32(0.5), "score": (1, 2.5)}]
    kept = table(rows=rows).to_json()["rows"]
    assert kept[0]["time"] == "inf"
    assert "nan" in kept[0]["score"]
    assert kept[1] == {"what": "b", "time": 0.5, "score": [1, 2.5]}
    json.dumps(kept, allow_nan=False)


@pytest.mark.parametrize(
    "change",
    [
        {"name": "../escape"},
        {"name": 7},
        {"title": ["no text"]},
        {"protocol": "x" * 20_000},
        {"columns": []},
        {"columns": [{"key": "a", "heading": "a"}, {"key": "a", "heading": "b"}]},
        {"columns": [{"key": "what", "heading": "what", "digits": 4000}]},
        {"columns": [{"key": "what", "heading": "what", "middle": "__class__"}]},
        {"columns": [{"key": "what", "heading": "what"}] * 100},
        {"rows": {}},
        {"rows": [{"elsewhere": 1}]},
        {"rows": [{"what": {"nested": 1}}]},
        {"rows": [{"time": [1.0, "2"]}]},
        {"rows": [{"time": [[1.0]]}]},
        {"rows": [{"time": True}]},
        {"rows": [{"what": "x" * 20_000}]},
        {"pareto": ["time", "nowhere"]},
        {"pareto": "time"},
        {"number": "first"},
        {"surprise": 1},
    ],
)
def test_what_is_no_table_is_refused(change):
    values = json.loads(json.dumps(table().to_json()))
    Table.from_json(values)
    with pytest.raises(ValueError, match="it"):
        Table.from_json(values | change)


@pytest.mark.parametrize("values", [None, [], "table", {"name": "x"}])
def test_what_is_nothing_like_a_table_is_refused(values):
    with pytest.raises(ValueError, match="does not hold"):
        Table.from_json(values)
