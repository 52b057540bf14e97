"""Where the events of `degense train` go: JSON lines, words on the terminal, TensorBoard."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from degense.app.cli.terminal import Bar
from degense.engine import events
from degense.engine.errors import DegenseError


class JsonEvents:
    """Events as JSON lines on standard output. When nobody reads them any more, `stop` is called: training stops and saves."""

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop

    def __call__(self, event: events.Event) -> None:
        try:
            print(json.dumps(events.to_json(event)), flush=True)
        except BrokenPipeError:
            self._stop()
            sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (for the rest of the process)


class TerminalEvents:
    """Events in words on standard error."""

    def __init__(self) -> None:
        self._bar = Bar()

    def __call__(self, event: events.Event) -> None:
        match event:
            case events.TrainingProgress():
                words = [f"{event.iteration}/{event.iterations}"]
                words += [f"{event.psnr:.1f} dB"] if event.psnr is not None else []
                words += [f"{event.gaussians} Gaussians"] if event.gaussians else []
                words += [f"{event.eta:.0f} s left"] if event.eta is not None else []
                self._bar(event.iteration / event.iterations, "  ".join(words))
            case events.Step(_, fraction, message):
                self._bar(fraction, message)
            case events.Stage(stage):
                self._say(f"{stage} …")
            case events.Reliability(words):
                self._say(words)
            case events.Rollback(iteration, reason):
                self._say(f"went back to iteration {iteration}: {reason}")
            case events.Stopped(0):
                self._say("stopped before the first step")
            case events.Stopped(iteration):
                self._say(f"stopped at iteration {iteration}; go on with --resume")
            case events.Done(run):
                self._say(f"done: {run}")
            case events.Preview() | events.Failed():  # previews are for a window; an error is printed where the command ends
                pass

    def _say(self, line: str) -> None:
        self._bar.close()
        print(line, file=sys.stderr, flush=True)


class TensorBoardEvents:
    """Loss, its terms, PSNR and the number of Gaussians, as event files in the folder `tensorboard` of a run.

    DegenseError when the package tensorboard is missing.
    """

    def __init__(self, run: Path) -> None:
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError as error:
            raise DegenseError("--logger tensorboard needs the package tensorboard: pip install 'degense[tensorboard]'.") from error
        self._folder, self._open = run / "tensorboard", SummaryWriter
        self._writer: Any = None

    def __call__(self, event: events.Event) -> None:
        if not isinstance(event, events.TrainingProgress):
            return
        if self._writer is None:  # not before the run folder is made, which must be empty then
            self._writer = self._open(str(self._folder), purge_step=event.iteration)
        totals = {"loss": event.loss, "psnr": event.psnr, "gaussians": event.gaussians}
        terms = {f"loss/{name}": value for name, value in event.losses.items()}
        for name, value in {**totals, **terms}.items():
            if value is not None:
                self._writer.add_scalar(name, value, event.iteration)

    def close(self) -> None:
        """Write what is left."""
        if self._writer is not None:
            self._writer.close()
