"""Baselines as rows of a benchmark's table, and marks at what lies below them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from degense.engine.data.readers import open_clip
from degense.engine.progress import Progress
from degense.engine.research.baselines import ClipFlow, below_baseline, note, number, score_baselines
from degense.engine.research.bench.table import Cell, Table

#: By name of baseline its scores with the teacher of each seed.
BaselineScores = dict[str, list[dict[str, Any]]]


def baselines_of(clip: Path, teachers: Sequence[str], progress: Progress) -> BaselineScores:
    """The baselines of a clip for each of several teachers; the flow is measured once."""
    opened, found = open_clip(clip), BaselineScores()
    flow = ClipFlow(opened, progress)
    for teacher in teachers:
        for name, scores in score_baselines(opened, teacher, flow=flow).items():
            found.setdefault(name, []).append(scores)
    return found


def add_baselines(table: Table, baselines: BaselineScores, keys: Mapping[str, tuple[str, bool]]) -> None:
    """Append the baselines to a table whose first column names the rows, and mark rows below one by †, with a note on which.

    `keys`: by key of a column the key of the score in it, and whether larger is better. Rows are compared by the mean over seeds;
    a baseline that has none of the scores is left out.
    """
    names = table.columns[0].key
    columns = {key: table.column(key) for key in keys}
    cells: dict[str, dict[str, Cell]] = {
        name: {key: [value for scores in seeds if (value := number(scores, score)) is not None] for key, (score, _) in keys.items()}
        for name, seeds in baselines.items()
    }
    cells = {name: row for name, row in cells.items() if any(row.values())}
    means = {name: {key: columns[key].value(row.get(key)) for key in keys} for name, row in cells.items()}
    rows = {str(row[names]): {key: columns[key].value(row.get(key)) for key in keys} for row in table.rows}
    notes = [table.notes]
    for key, (_, larger) in keys.items():
        below = below_baseline(rows, means, key, larger)
        notes.append(note(below, columns[key].heading))
        for row in table.rows:
            if str(row[names]).removesuffix(" †") in below and not str(row[names]).endswith("†"):
                row[names] = f"{row[names]} †"
    table.notes = " ".join(filter(None, notes))
    table.rows += [{names: f"baseline: {name}", **row} for name, row in cells.items()]
