"""`degense export`."""

from __future__ import annotations

import argparse

from app.exports import ExportOptions, get_format
from app.terminal import Bar, run_steps


def export(options: argparse.Namespace) -> None:
    chosen = get_format(options.format)
    from engine.scene import Scene

    scene = Scene.open(options.run_folder)
    wanted = ExportOptions(tuple(options.prompts), options.decoder, options.threshold, options.frame, options.layer, source=options.source)
    print(run_steps(chosen.export(scene, options.out, wanted), Bar()))
