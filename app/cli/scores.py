"""`degense eval`, `compare` and `bench`. No module of the product imports research: it is loaded by name when it is needed."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from contextlib import closing
from functools import partial
from typing import Any

from degense.app.cli.arguments.reliability_options import campaign_of
from degense.app.cli.arguments.sweep_options import sweep_of
from degense.app.cli.options import anonymised_scene, clip_options
from degense.app.cli.terminal import Bar, table
from degense.app.cli.training import StopFlag
from degense.engine.errors import Cancelled, ClipError
from degense.engine.files import write_text


def evaluate(options: argparse.Namespace) -> None:
    from degense.engine.data.readers import open_clip
    from degense.engine.metrics.evaluate import evaluate as score
    from degense.engine.metrics.image import fetch_lpips
    from degense.engine.scene import Scene
    from degense.engine.scene.anonymous import AnonymousClip, anonymous_scores, read_cover

    if options.lpips:
        fetch_lpips()
    scene = Scene.open(options.run_folder)
    clip = open_clip(options.clip, clip_options(options)) if options.clip else scene.clip
    if clip is None:
        raise ClipError(f"The clip that {options.run_folder} was made from is not there any more; say where it is with --clip.")
    shown = anonymised_scene(scene, options)
    with closing(Bar()) as bar:
        scores = score(scene, clip, bar)
    if shown is not scene:
        scores = anonymous_scores(scores)
        shown.clip = clip = AnonymousClip(clip, None if options.cover is None else read_cover(options.cover, scene.clip_size))
    if options.json:
        write_text(options.json, json.dumps(scores, indent=2, allow_nan=False))
    print(table(_printable(scores)))
    if options.report:
        with closing(Bar()) as bar:
            paths = research().report_run(shown, clip, scores, options.report, bar)
        print(paths)


def _printable(scores: dict[str, Any]) -> dict[str, Any]:
    """Scores without lists, which are for files."""
    read = {key: _printable(value) if isinstance(value, dict) else value for key, value in scores.items()}
    return {key: value for key, value in read.items() if not isinstance(value, list) and value != {}}


#: Measure the program around the engine, and are not among "all": one needs a display, one hours.
OF_THE_PROGRAM = {
    "window": (
        "degense.app.research.window_bench",
        "how instant the window is: first frame, scrubbing, prompts, brush, stalls (needs a display)",
    ),
    "batch": (
        "degense.app.research.batch_bench",
        "many clips: a batch against the same commands one by one, and on Dask workers of which one is killed",
    ),
    "reliability": (
        "degense.app.research.reliability",
        "kills, damaged inputs, hours of work (needs a display), faults; `reliability kills` and so on for one of them",
    ),
}


def research() -> Any:
    """The module `engine.research.commands`."""
    return importlib.import_module("degense.engine.research.commands")


def bench(options: argparse.Namespace) -> None:
    """List benchmarks, run some, or make the page of saved tables."""
    commands, names = research(), options.names
    if not names:
        print(commands.list_benchmarks(OF_THE_PROGRAM))
        return
    if names[0] == "report":
        print(commands.report_benchmarks(names[1:], options.out))
        return
    about = {name: getattr(options, name) for name in ("device", "seeds", "repeats", "quick", "out")}
    if names[0] == "reliability":
        names, about["sweep"] = names[:1], campaign_of(options)
    else:
        about["sweep"] = sweep_of(options)
    with closing(Bar()) as bar:

        def show(section: str) -> None:
            bar.close()
            print(section, end="\n\n", flush=True)

        commands.run_benchmarks(names, OF_THE_PROGRAM, show, bar, clips=options.clip, **about)


def compare(options: argparse.Namespace) -> None:
    """Train and score systems on one clip; the table on standard output, the report in the folder."""
    from degense.engine.data.readers import open_clip
    from degense.engine.training import TrainConfig

    config = TrainConfig.preset_of(
        options.preset, iterations=options.iterations, max_gaussians=options.max_gaussians, device=options.device
    )
    seeds, methods = list(range(options.seeds)), options.methods or None
    try:
        with closing(Bar()) as bar, StopFlag() as stop:
            clip = partial(open_clip, options.clip, clip_options(options))
            said = research().compare(clip, options.out, config, methods, seeds, options.teacher, bar, stop)
    except Cancelled:
        print("what is trained is kept; the same command goes on from there", file=sys.stderr)
        raise
    print(said)
