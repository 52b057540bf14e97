"""`degense movie`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from degense.app.cli.options import anonymised_scene, asked_prompts
from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.cameras.state import Stop, load_path
from degense.app.features.movies.layer_stack import LayerStack
from degense.app.features.movies.movie import RECORDING, MovieOptions, make_movie, view_of
from degense.app.features.viewer.layer_images import check_frame

if TYPE_CHECKING:
    from degense.engine.scene import Scene


def movie(options: argparse.Namespace) -> None:
    from degense.engine.scene import Scene

    names = [name.strip() for name in options.layers.split(",")]
    layers = tuple(name if name == RECORDING else str(LayerStack.read(name)) for name in names)
    view_state = view_of(asked_prompts(options))
    scene = anonymised_scene(Scene.open(options.run_folder), options)
    stops = checked_path(scene, options.cameras) if options.cameras is not None else ()
    wanted = MovieOptions(view_state, layers, options.size, options.fps, None, stops, options.time, options.titled)
    print(run_steps(make_movie(scene, options.out, wanted), Bar()))


def checked_path(scene: Scene, path: Path) -> tuple[Stop, ...]:
    """The stops of a camera path, at frames that the scene has. DegenseError otherwise."""
    stops = load_path(path)
    for stop in stops:
        check_frame(scene, stop.frame)
    return stops
