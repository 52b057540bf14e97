"""`degense bench` and `degense compare`. No module of the product imports research: it is loaded by name when a command needs it."""

from __future__ import annotations

import argparse
import importlib
import sys
from typing import Any

from degense.app.cli.terminal import Bar
from degense.app.cli.train import StopFlag, clip_options
from degense.engine.errors import Cancelled

#: Needs a display, so it is not one of "all".
OF_THE_WINDOW = {
    "window": (
        "degense.app.research.window_bench",
        "how instant the window is: first frame, scrubbing, prompts, brush, stalls (needs a display)",
    )
}


def research() -> Any:
    """The module `engine.research.commands`."""
    return importlib.import_module("degense.engine.research.commands")


def bench(options: argparse.Namespace) -> None:
    """List benchmarks, run some, or make the page of saved tables."""
    commands, names = research(), options.names
    if not names:
        print(commands.list_benchmarks(OF_THE_WINDOW))
        return
    if names[0] == "report":
        print(commands.report_benchmarks(names[1:], options.out))
        return
    bar = Bar()

    def show(section: str) -> None:
        bar.close()
        print(section, end="\n\n", flush=True)

    about = {name: getattr(options, name) for name in ("device", "seeds", "repeats", "quick", "out")}
    try:
        commands.run_benchmarks(names, OF_THE_WINDOW, show, bar, clips=options.clip, **about)
    finally:
        bar.close()


def compare(options: argparse.Namespace) -> None:
    """Train and score systems on one clip; the table on standard output, the report in the folder."""
    from degense.engine.data.readers import open_clip
    from degense.engine.training import TrainConfig

    config = TrainConfig.preset_of(
        options.preset, iterations=options.iterations, max_gaussians=options.max_gaussians, device=options.device, fit=False
    )
    bar, seeds, stop = Bar(), list(range(options.seeds)), StopFlag()
    try:
        with stop:
            said = research().compare(
                lambda: open_clip(options.clip, clip_options(options)),
                options.out,
                config,
                options.methods or None,
                seeds,
                options.teacher,
                bar,
                stop,
            )
    except Cancelled:
        bar.close()
        print("what is trained is kept; the same command goes on from there", file=sys.stderr)
        raise
    finally:
        bar.close()
    print(said)
