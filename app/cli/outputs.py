"""`degense render`, `degense segment`, `degense export` and `degense share`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from degense.app.cli.movies import checked_path
from degense.app.cli.options import anonymised_scene, asked_prompts, chosen_encoder, refuse_cover
from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.annotate.label_sets import annotated, at_frames, label_source, names_of, write_labels
from degense.app.features.export.formats import ExportOptions, draw_frames, export_movie, get_format
from degense.app.features.movies.movie import MovieOptions, make_movie, view_of
from degense.app.features.prompts.segment import write_clip_masks
from degense.app.features.share.page import share as share_scene
from degense.app.features.viewer.layer_images import check_frame, get_layer, layer_rgb, write_npy, write_png
from degense.engine.annotation.formats import LABEL_FORMATS
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps
from degense.engine.scene.uncertainty import DOUBTFUL, RELATIVE

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
    scene = anonymised_scene(Scene.open(options.run_folder, encoder=chosen_encoder(options)), options)
    if options.cameras is not None:
        view_state = view_of(wanted.prompt_set, layer.name, options.range)
        path = MovieOptions(view_state, (layer.name,), stops=checked_path(scene, options.cameras))
        print(run_steps(make_movie(scene, options.out, path), Bar()))
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


def _render_frame(scene: Scene, layer: Layer, frame: float, out: Path, options: ExportOptions) -> None:
    request = options.layer_request(frame)
    if out.suffix == ".npy":
        image = layer.image(scene, request)
        write_npy(out, image.values)
        if image.uncertain is not None and image.uncertain.any():
            most = f"{DOUBTFUL * scene.states.depth:.3g} {scene.unit} and {RELATIVE:.0%} of the displacement"
            print(f"{image.uncertain.mean():.1%} of the pixels hold a guess, kept as it is; where: --layer uncertainty, above {most}")
    elif out.suffix.lower() == ".png":
        write_png(out, layer_rgb(scene, layer, request, options.span))
    else:
        raise DegenseError(f"{out} must end in .png or .npy.")


def _render_frames(scene: Scene, layer: Layer, frames: Sequence[int], out: Path, options: ExportOptions) -> Steps[None]:
    suffix = out.suffix.lower()
    if suffix == ".mp4":
        yield from export_movie(scene, out, replace(options, frames=frames))
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
    scene = anonymised_scene(Scene.open(options.run_folder, encoder=chosen_encoder(options)), options)
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
    if not (options.path / "run.json").is_file():
        print(run_steps(_annotations_of_clip(options), Bar()))
        return
    from degense.engine.scene import Scene
    from degense.engine.scene.anonymous import HOLD_GAUSSIANS

    if options.format in HOLD_GAUSSIANS:
        refuse_cover(options)
    scene = anonymised_scene(Scene.open(options.path), options)
    frames: Sequence[int] | None = None
    if options.frames == "labelled":
        frames = label_source(scene, "annotations", prompts).frames
    elif options.frames is not None:
        frames = _chosen_frames(scene, options)
    wanted = ExportOptions(prompts, options.frame, options.layer, source=options.source, frames=frames)
    print(run_steps(chosen.export(scene, options.out, wanted), Bar()))


def share(options: argparse.Namespace) -> None:
    from degense.engine.scene import Scene

    prompts = asked_prompts(options)
    refuse_cover(options)
    print(run_steps(share_scene(anonymised_scene(Scene.open(options.run_folder), options), options.out, prompts), Bar()))


def _annotations_of_clip(options: argparse.Namespace) -> Steps[str]:
    """What was annotated in a clip without a run, and the labels that it came with."""
    from degense.app.cli.labels import Subject

    if options.format not in LABEL_FORMATS or options.source == "masks":
        raise DegenseError(f"{options.path} is no run, so only its annotations can be exported; train it first.")
    subject = Subject(options.path)
    maps = annotated(subject.work, subject.clip)
    if options.frames not in (None, "labelled"):
        maps = at_frames(maps, range(len(subject.clip))[slice(*options.frames)])
    if options.anonymise:
        maps = replace(maps, names=names_of(None, len(maps.names)))
    return write_labels(options.format, maps, options.out)


def checksum(options: argparse.Namespace) -> None:
    """Write the check sums of a run, or say that it is as they were written."""
    from degense.engine.store.checksums import SUMS, check_checksums, write_checksums

    folder = options.run_folder
    if options.check:
        print(f"{folder}: all {len(check_checksums(folder))} files are as {SUMS} says")
    else:
        names = write_checksums(folder)
        print(f"{folder / SUMS}: {', '.join(names)}")
