"""Previews of the training that is shown, each beside the frame as it was recorded."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from degense.app.features.train.job import TrainingJob
from degense.app.features.train.monitor import TrainingMonitor
from degense.app.shell.worker import Worker
from degense.engine.data.files.images import read_rgb
from degense.engine.errors import DegenseError

log = logging.getLogger(__name__)


class Previews:
    """Shows previews at once; the recorded frame is read by the worker the first time. `shown()` is the job that the monitor shows."""

    def __init__(self, monitor: TrainingMonitor, worker: Worker, shown: Callable[[], TrainingJob | None]) -> None:
        self._monitor, self._worker, self._shown = monitor, worker, shown
        self._observed: tuple[TrainingJob, int, np.ndarray] | None = None

    def show(self, job: TrainingJob, path: str, frame: int) -> None:
        """Show the picture in a file, of that frame of the clip that a job trains on."""
        try:
            picture = read_rgb(Path(path))
        except (DegenseError, OSError):
            return  # there will be another one soon
        if self._shown() is not job:
            return
        known = self._observed is not None and self._observed[:2] == (job, frame)
        self._monitor.set_preview(picture, self._observed[2] if known and self._observed else None)
        if not known and not self._worker.busy("observed"):

            def found(rgb: np.ndarray) -> None:
                self._observed = (job, frame, rgb)
                if self._shown() is job:
                    self._monitor.set_preview(picture, rgb)

            self._worker.submit("observed", lambda: _recorded(job, frame), found, log.warning)


def _recorded(job: TrainingJob, frame: int) -> np.ndarray:
    """A frame of the clip that a job trains on, as it was recorded."""
    from degense.engine.data.readers import ClipOptions, open_clip

    return open_clip(job.clip, ClipOptions(**job.clip_options())).frame(frame)
