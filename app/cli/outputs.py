"""`degense render`, `degense segment` and `degense export`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from degense.app.cli.options import asked_prompts, chosen_encoder
from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.cameras.movie import camera_movie
from degense.app.features.cameras.state import load_path
from degense.app.features.export.formats import ExportOptions, draw_frames, get_format, write_movie
from degense.app.features.prompts.segment import write_clip_masks
from degense.app.features.viewer.layer_images import check_frame, get_layer, layer_rgb, write_npy, write_png
from degense.app.session.view_state import PROMPT_COLOURS, ColourRange, Prompt, ViewState
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.layers import Layer
    from degense.engine.scene import Scene
    from degense.engine.semantics.prompts import PromptSet


def render(options: argparse.Namespace) -> None:
    """Draw one frame or several. One frame is coloured over its own range; a sequence over the range of all its frames."""
    from degense.engine.scene import Scene

    layer = get_layer(options.layer)
    options.layer = layer.name
    wanted = ExportOptions(asked_prompts(options), layer=options.layer, span=options.range)
    scene = Scene.open(options.run_folder, encoder=chosen_encoder(options))
    if options.cameras is not None:
        stops = load_path(options.cameras)
        for stop in stops:
            check_frame(scene, stop.frame)
        print(run_steps(camera_movie(scene, stops, _look(options), options.out), Bar()))
    elif options.frames is None:
        _render_frame(scene, layer, check_frame(scene, options.frame), options.out, wanted)
    else:
        run_steps(_render_frames(scene, layer, _chosen_frames(scene, options), options.out, wanted), Bar())


def _chosen_frames(scene: Scene, options: argparse.Namespace) -> range:
    first, last = options.frames
    frames = range(scene.frames)[first:last]
    if not frames:
        raise DegenseError(f"There are no such frames in {scene.name}; its frames are 0 to {scene.frames - 1}.")
    return frames


def _look(options: argparse.Namespace) -> ViewState:
    """What the window would show with these options."""
    plain = ViewState()
    low, high = options.range or (0.0, 1.0)
    return ViewState(
        layer=options.layer,
        prompts=tuple(Prompt(text, PROMPT_COLOURS[i % len(PROMPT_COLOURS)]) for i, text in enumerate(options.prompts)),
        threshold=plain.threshold if options.threshold is None else options.threshold,
        decoder=options.decoder or plain.decoder,
        ranges=((options.layer, ColourRange("fixed", low, high)),) if options.range else (),
    )


def _render_frame(scene: Scene, layer: Layer, frame: float, out: Path, options: ExportOptions) -> None:
    from degense.engine.scene import REVEALED

    request = options.layer_request(frame)
    if out.suffix == ".npy":
        image = layer.image(scene, request)
        write_npy(out, image.values)
        if image.uncertain is not None and image.uncertain.any():
            share = f"{image.uncertain.mean():.1%}"
            print(f"{share} of the pixels hold a guess, kept as it is; where: --layer observability, below {REVEALED:g}")
    elif out.suffix.lower() == ".png":
        write_png(out, layer_rgb(scene, layer, request, options.span))
    else:
        raise DegenseError(f"{out} must end in .png or .npy.")


def _render_frames(scene: Scene, layer: Layer, frames: Sequence[int], out: Path, options: ExportOptions) -> Steps[None]:
    suffix = out.suffix.lower()
    if suffix == ".mp4":
        yield from write_movie(scene, out, frames, options)
    elif suffix == ".npy":
        values = []
        for done, frame in enumerate(frames):
            yield done / len(frames), f"frame {frame}"
            values.append(layer.image(scene, options.layer_request(frame)).values)
        write_npy(out, np.stack(values))
    elif suffix == "":
        yield from draw_frames(scene, layer, frames, options, lambda frame, picture: write_png(out / f"{frame:06d}.png", picture))
    else:
        raise DegenseError(f"Several frames go into a folder, an .npy or an .mp4 file; {out} is none of them.")


def segment(options: argparse.Namespace) -> None:
    from degense.engine.scene import Scene
    from degense.engine.scene.clip_query import decode_frame

    prompts = asked_prompts(options)
    scene = Scene.open(options.run_folder, encoder=chosen_encoder(options))
    if options.frames is not None:
        _segment_clip(scene, prompts, options)
        return
    frame = check_frame(scene, options.frame)
    if options.out.suffix.lower() not in (".png", ".npy"):
        raise DegenseError(f"{options.out} must end in .png or .npy.")
    found = decode_frame(scene, prompts, frame)
    if options.out.suffix.lower() == ".npy":
        write_npy(options.out, found.masks[0] if len(found.masks) == 1 else found.masks)
    elif len(found.masks) == 1:
        write_png(options.out, found.masks[0].astype(np.uint8) * 255)
    else:
        write_png(options.out, found.numbers)
    for text, mask in zip(prompts.prompts, found.masks, strict=True):
        print(f"{text}: {mask.mean():.1%} of the picture")


def _segment_clip(scene: Scene, prompts: PromptSet, options: argparse.Namespace) -> None:
    frames = _chosen_frames(scene, options)
    areas = run_steps(write_clip_masks(scene, prompts, frames, options.out), Bar())
    print(f"{options.out}: masks of {len(frames)} frames")
    for text, values in areas.items():
        print(f"{text}: {values.mean():.1%} of the picture on average, from {values.min():.1%} to {values.max():.1%}")


def export(options: argparse.Namespace) -> None:
    chosen, prompts = get_format(options.format), asked_prompts(options)
    from degense.engine.scene import Scene

    scene = Scene.open(options.run_folder)
    wanted = ExportOptions(prompts, options.frame, options.layer, source=options.source)
    print(run_steps(chosen.export(scene, options.out, wanted), Bar()))
