"""`degense export`."""

from __future__ import annotations

import argparse

from degense.app.cli.draw import asked_prompts
from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.export.formats import ExportOptions, get_format


def export(options: argparse.Namespace) -> None:
    chosen, prompts = get_format(options.format), asked_prompts(options)
    from degense.engine.scene import Scene

    scene = Scene.open(options.run_folder)
    wanted = ExportOptions(prompts, options.frame, options.layer, source=options.source)
    print(run_steps(chosen.export(scene, options.out, wanted), Bar()))
