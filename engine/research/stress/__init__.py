"""Hostile scenes and clips: `run` tries them all and says what came out.

A case passes when its outcome is "ok" or, for a clip that cannot be used, one sentence that says why; when no number that came out is
anything but finite; and when the error against float64, where the reference can follow, stays within the tolerances of
`engine.research.bench.raster_check`. Anything else stands in the table in capitals.
"""

from __future__ import annotations

from collections.abc import Iterator

from degense.engine.progress import Progress, silent
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Table
from degense.engine.research.stress import clips, features, long, scenes


def run(options: BenchOptions, progress: Progress = silent) -> Iterator[Table]:
    """Four tables: scenes, features, clips, long."""
    parts = (scenes, features, clips, long)
    for i, part in enumerate(parts):
        yield part.table(options, lambda fraction, message, i=i: progress((i + fraction) / len(parts), message))
