"""A benchmark that takes no time."""

from __future__ import annotations

from collections.abc import Iterator

from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Column, Table


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    for number, name in enumerate(("tiny-second-by-name", "tiny-first-by-name")):
        progress(number / 2, name)
        yield Table(
            name,
            f"Table {number}",
            f"{options.repeats} repeats, {len(options.seeds)} seeds.",
            [Column("what", "what"), Column("time", "time, ms"), Column("error", "error", 3, "mean")],
            [
                {"what": "slow", "time": [9.0, 10.0, 12.0], "error": 0.0},
                {"what": "fast", "time": 1.0, "error": [0.25, 0.5]},
                {"what": "worse", "time": 11.0, "error": 0.75},
                {"what": "not measured", "time": None, "error": None},
            ],
            pareto=("time", "error") if number == 0 else None,
            notes="Slow is exact." if number == 0 else "",
        )
