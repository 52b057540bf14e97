"""Real clips: systems and baselines on held-out frames, and tracks of points that people marked; a sweep whose scenes are clips."""

from __future__ import annotations

from collections.abc import Iterator

from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Table
from degense.engine.research.real_clips.plan import plan_of
from degense.engine.research.real_clips.tables import tables_of
from degense.engine.research.real_clips.work import baseline_files, prepare_clip, score_clip_baselines, score_job
from degense.engine.research.sweep.run import Work, sweep

CLIPS = Work(prepare_clip, baseline_files, score_clip_baselines, score_job, tables_of)


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Train what is missing in the folder of the sweep, and make a table of each clip."""
    return sweep(plan_of(options), CLIPS, progress)
