"""`degense`, `degense PATH` and `degense demo`."""

from __future__ import annotations

import argparse

from degense.app.cli.terminal import Bar, run_steps
from degense.engine.errors import DegenseError


def window(options: argparse.Namespace) -> int:
    if options.path is not None and not options.path.exists():
        raise DegenseError(f"{options.path} is neither a command nor a file or folder; see degense --help.")
    from degense.app.application import run_window

    return run_window(options.path)


def demo(options: argparse.Namespace) -> int:
    if options.headless is None:
        from degense.app.application import run_window
        from degense.app.session.sample import demo_run

        return run_window(demo_run())
    from degense.app.cli.demo import draw_demo
    from degense.app.session.sample import demo_run
    from degense.engine.scene import Scene

    scene = Scene.open(demo_run())
    for sentence in run_steps(draw_demo(scene, options.headless), Bar()):
        print(sentence)
    return 0
