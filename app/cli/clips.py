"""`degense phantom`, `degense info` and `degense datasets`."""

from __future__ import annotations

import argparse
import importlib
import json
from contextlib import closing
from dataclasses import asdict, fields

from degense.app.cli.options import clip_options, refuse_non_empty
from degense.app.cli.terminal import Bar
from degense.engine.files import write_text


def phantom(options: argparse.Namespace) -> None:
    from degense.engine.data.synthetic import PhantomOptions, make_phantom

    width, height = options.size or (None, None)
    family = {} if options.family is None else {"kind": "family", "seed": options.family}
    if "family" in (options.kind, family.get("kind")):
        importlib.import_module("degense.engine.research.surgeries")
    given = {**vars(options), "width": width, "height": height, **family}
    chosen = {item.name: value for item in fields(PhantomOptions) if (value := given[item.name]) is not None}
    refuse_non_empty(options.out)
    with closing(Bar()) as bar:
        make_phantom(
            options.out,
            PhantomOptions(**chosen),
            bar,
        )
    print(f"{options.out}: a synthetic clip with its truth; reconstruct it with: degense train {options.out} --out RUN")


def info(options: argparse.Namespace) -> None:
    from degense.engine.data.readers import describe, open_clip

    clip = open_clip(options.clip, clip_options(options))
    if options.poses == "estimate":
        from degense.engine.data.poses import find_cameras

        with closing(Bar()) as bar:
            clip = find_cameras(clip, bar, labelled=bool(clip.labelled_frames))
    print(describe(clip))


def datasets(options: argparse.Namespace) -> None:
    """One line a clip, as it is looked at; a clip that cannot be opened is told like the others."""
    from degense.engine.data.readers.detect import list_clips

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
