"""`degense eval`, `degense info` and `degense doctor`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from app.commands.comparing import report_run
from app.commands.making import clip_options
from app.terminal import Bar, table
from engine.errors import ClipError
from engine.files import write_text

#: Long lists, which are for files.
NOT_PRINTED = {"iou_frames", "curve", "reliability"}


def evaluate(options: argparse.Namespace) -> None:
    from engine.metrics.evaluate import evaluate as score
    from engine.readers import open_clip
    from engine.scene import Scene

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
        report_run(scene, clip, scores, options.report)


def _printable(scores: dict[str, Any]) -> dict[str, Any]:
    return {key: _printable(value) if isinstance(value, dict) else value for key, value in scores.items() if key not in NOT_PRINTED}


def info(options: argparse.Namespace) -> None:
    from engine.readers import describe, open_clip

    clip = open_clip(options.clip, clip_options(options))
    if options.poses == "estimate":
        from engine.poses import find_cameras

        bar = Bar()
        try:
            clip = find_cameras(clip, bar)
        finally:
            bar.close()
    print(describe(clip))


def doctor(options: argparse.Namespace) -> int:
    from app.doctor import report

    text, ok = report()
    print(text)
    return 0 if ok else 1
