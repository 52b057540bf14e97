"""`degense compare`, and the report of `degense eval`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from degense.app.cli.terminal import Bar
from degense.app.cli.train import StopFlag, clip_options
from degense.engine.errors import Cancelled, DegenseError

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene


def compare(options: argparse.Namespace) -> None:
    """Train and score systems on one clip; the table on standard output, the report in the folder."""
    from degense.engine.data.readers import open_clip
    from degense.engine.research.comparison import Comparison
    from degense.engine.research.report import write_report
    from degense.engine.research.report.tables import tables_of
    from degense.engine.research.systems import SYSTEMS, as_system
    from degense.engine.training import TrainConfig

    config = TrainConfig.preset_of(
        options.preset, iterations=options.iterations, max_gaussians=options.max_gaussians, device=options.device, fit=False
    )
    methods = list(dict.fromkeys(filter(None, options.methods.split(",")))) if options.methods else list(SYSTEMS)
    if not methods:
        raise DegenseError(f"--methods names none; choose from {', '.join(SYSTEMS)}.")
    for method in methods:
        as_system(method, config)
    seeds = list(range(options.seeds))
    clip = open_clip(options.clip, clip_options(options))
    comparison = Comparison.open(clip, options.out, config, options.teacher)
    bar, stop = Bar(), StopFlag()
    try:
        with stop:
            entries = comparison.run(methods, seeds, bar, stop)
        pictures = comparison.pictures(entries, seeds[0])
    except Cancelled:
        bar.close()
        print("what is trained is kept; the same command goes on from there", file=sys.stderr)
        raise
    finally:
        bar.close()
    facts = _clip_facts(clip, entries[0].runs[0]) | {
        "teacher": comparison.teacher,
        "budget": f"preset {config.preset}, {config.iterations:,} steps, at most {config.max_gaussians:,} Gaussians, the same for all",
        "seeds": ", ".join(map(str, seeds)),
    }
    paths = write_report(options.out, f"Systems on {clip.name}", facts, entries, clip.classes, pictures)
    print(tables_of(entries)[0].markdown())
    print(f"\n{_list_of(paths)}")


def report_run(scene: Scene, clip: Clip, scores: dict[str, Any], folder: Path) -> None:
    """The report of one run's scores. DegenseError for a run without masks to score."""
    from degense.engine.research.report import Entry, pictures_of, write_report
    from degense.engine.research.report.pictures import truths_of

    if "masks" not in scores:
        raise DegenseError(f"{scene.name} or its clip has no labels, so there are no masks to report; the scores are on standard output.")
    entry = Entry(scene.name, f"{scores['preset']} preset, {scores['routing']} routing", [scores])
    frames = scores["mask_frames"]
    pictures = truths_of(clip, frames) + pictures_of(scene, clip, frames, entry.decoder, scene.name)
    facts = _clip_facts(clip, scores) | {"teacher": scene.run.info["teacher"]["provenance"], "cameras": str(scores["poses"])}
    print(_list_of(write_report(folder, f"Scores of {scene.name}", facts, [entry], clip.classes, pictures)))


def _clip_facts(clip: Clip, scores: dict[str, Any]) -> dict[str, str]:
    width, height = clip.size
    frames, trained = scores["mask_frames"], scores["mask_frames_trained"]
    return {
        "clip": f"{clip.name}: {len(clip)} frames, {width} × {height}",
        "masks scored on": f"{len(frames)} frame{'s' * (len(frames) != 1)} ({', '.join(map(str, frames))})"
        + (f"; of these, trained on: {', '.join(map(str, trained))}" if trained else ", none trained on"),
    }


def _list_of(paths: list[Path]) -> str:
    return "\n".join(map(str, paths))
