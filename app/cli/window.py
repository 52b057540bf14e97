"""`degense`, `degense PATH`, `degense view` and `degense demo`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from degense.app.cli.terminal import Bar, run_steps
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.scene import Scene

PROMPT = "gallbladder"


def window(options: argparse.Namespace) -> int:
    if options.path is not None and not options.path.exists():
        raise DegenseError(f"{options.path} is neither a command nor a file or folder; see degense --help.")
    return _show(options.path)


def _show(path: Path | None) -> int:
    from degense.app.start_up import load_window

    load_window()
    from degense.app.application import run_window

    return run_window(path)


def view(options: argparse.Namespace) -> int:
    if not options.rerun:
        return _show(options.run_folder)
    from degense.app.interop.rerun_recording import send_run
    from degense.engine.scene import Scene

    print(run_steps(send_run(Scene.open(options.run_folder), options.save), Bar()))
    return 0


def demo(options: argparse.Namespace) -> int:
    from degense.app.session.sample import demo_run

    if options.headless is None:
        return _show(demo_run())
    from degense.engine.scene import Scene

    scene = Scene.open(demo_run())
    for sentence in run_steps(_draw_sample(scene, options.headless), Bar()):
        print(sentence)
    return 0


def _draw_sample(scene: Scene, out: Path) -> Steps[list[str]]:
    """Write the pictures of the sample, for machines without a display; the sentences that say what they show."""
    from degense.app.features.viewer.layer_images import beyond, get_layer, laid_over, layer_rgb, with_colour_bar, write_png
    from degense.app.session.view_state import PROMPT_COLOURS
    from degense.engine.colour_maps import mask_overlay
    from degense.engine.layers import LayerRequest, layer_range
    from degense.engine.scene.clip_query import decode_frame
    from degense.engine.semantics.prompts import PromptSet

    frame = scene.frames - 1
    rgb = scene.render_rgb(frame)
    said = []
    yield 0.0, "colours"
    write_png(out / "rgb.png", rgb)
    said.append(f"rgb.png: frame {frame} of {scene.frames}, reconstructed ({scene.clip_size[0]} × {scene.clip_size[1]})")
    yield 0.2, f"mask of {PROMPT}"
    [mask] = decode_frame(scene, PromptSet((PROMPT,)), frame).masks
    write_png(out / f"mask_{PROMPT}.png", laid_over(rgb, mask_overlay([(mask, PROMPT_COLOURS[0])], 0.5)))
    said.append(f"mask_{PROMPT}.png: what the prompt “{PROMPT}” finds in it, {mask.mean():.1%} of the picture")
    for done, name in ((0.5, "displacement"), (0.7, "warp")):
        layer = get_layer(name)
        yield done, layer.title.lower()
        request = LayerRequest(frame=frame)
        low, high = layer_range(scene, layer, request, "sequence")
        unit = layer.unit(scene)
        picture, uncertain = layer_rgb(scene, layer, request, (low, high)), layer.uncertain(scene, request)
        outside = beyond(layer.pixels(scene, request), low, high)
        hatched = uncertain is not None and bool(uncertain.any())
        write_png(out / f"{name}.png", with_colour_bar(picture, layer.title, unit, low, high, layer.cmap, hatched=hatched, outside=outside))
        said.append(f"{name}.png: {layer.description} Colours from {low:.3g} to {high:.3g} {unit}.")
    return said
