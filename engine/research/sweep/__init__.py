"""A sweep over the family of surgeries: systems × teachers × depths × seeds, several trainings at a time, and its tables."""

from __future__ import annotations

from collections.abc import Iterator

from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Table
from degense.engine.research.sweep.clips import baseline_files, prepare_scene, score_scene_baselines
from degense.engine.research.sweep.plan import plan_of
from degense.engine.research.sweep.run import Work, sweep
from degense.engine.research.sweep.tables import tables_of
from degense.engine.research.sweep.work import score_job

SURGERIES = Work(prepare_scene, baseline_files, score_scene_baselines, score_job, tables_of)


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Train what is missing in the folder of the sweep, and make the tables of what is there."""
    return sweep(plan_of(options), SURGERIES, progress)
