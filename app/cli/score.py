"""`degense eval`, `degense info`, `degense datasets` and `degense doctor`."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import Any

from degense.app.cli.research import research
from degense.app.cli.terminal import Bar, table
from degense.app.cli.train import clip_options
from degense.engine.errors import ClipError
from degense.engine.files import write_text

#: Long lists, which are for files.
NOT_PRINTED = {"iou_frames", "curve", "reliability"}


def evaluate(options: argparse.Namespace) -> None:
    from degense.engine.data.readers import open_clip
    from degense.engine.metrics.evaluate import evaluate as score
    from degense.engine.scene import Scene

    scene = Scene.open(options.run_folder)
    clip = open_clip(options.clip, clip_options(options)) if options.clip else scene.clip
    if clip is None:
        raise ClipError(f"The clip that {options.run_folder} was made from is not there any more; say where it is with --clip.")
    bar = Bar()
    try:
        scores = score(scene, clip, bar)
    finally:
        bar.close()
    if options.json:
        write_text(options.json, json.dumps(scores, indent=2, allow_nan=False))
    print(table(_printable(scores)))
    if options.report:
        print(research().report_run(scene, clip, scores, options.report))


def _printable(scores: dict[str, Any]) -> dict[str, Any]:
    return {key: _printable(value) if isinstance(value, dict) else value for key, value in scores.items() if key not in NOT_PRINTED}


def info(options: argparse.Namespace) -> None:
    from degense.engine.data.readers import describe, open_clip

    clip = open_clip(options.clip, clip_options(options))
    if options.poses == "estimate":
        from degense.engine.data.poses import find_cameras

        bar = Bar()
        try:
            clip = find_cameras(clip, bar)
        finally:
            bar.close()
    print(describe(clip))


def datasets(options: argparse.Namespace) -> None:
    """One line a clip, as it is looked at; a clip that cannot be opened is told like the others."""
    from degense.engine.data.readers.datasets import list_clips

    entries = []
    for entry in list_clips(options.folder):
        entries.append(entry)
        name = str(entry.path.relative_to(options.folder)) if entry.path != options.folder else entry.path.name
        if entry.problem:
            print(f"{name}: {entry.problem}", flush=True)
            continue
        split = f", {entry.split}" if entry.split else ""
        what = f"{entry.frames} frames ({entry.test_frames} held out), {entry.size[0]} × {entry.size[1]}, {entry.labelled} labelled"
        print(f"{name}: {entry.layout}{split}, {what}" + (f": {', '.join(entry.classes)}" if entry.classes else ""), flush=True)
    frames, wrong = sum(entry.frames for entry in entries), sum(bool(entry.problem) for entry in entries)
    print(f"{len(entries)} clips, {frames} frames" + (f"; {wrong} cannot be opened" if wrong else ""))
    if options.json:
        write_text(options.json, json.dumps([{**asdict(entry), "path": str(entry.path)} for entry in entries], indent=1))


def doctor(options: argparse.Namespace) -> int:
    from degense.app.diagnostics import report

    text, ok = report()
    print(text)
    return 0 if ok else 1
