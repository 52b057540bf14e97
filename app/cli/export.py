"""`degense export`."""

from __future__ import annotations

import argparse

from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.export.formats import ExportOptions, get_format


def export(options: argparse.Namespace) -> None:
    chosen = get_format(options.format)
    from degense.engine.scene import Scene

    scene = Scene.open(options.run_folder)
    wanted = ExportOptions(tuple(options.prompts), options.decoder, options.threshold, options.frame, options.layer, source=options.source)
    print(run_steps(chosen.export(scene, options.out, wanted), Bar()))
