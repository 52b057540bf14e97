"""What several commands read from their options."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.data.readers import ClipOptions
    from degense.engine.scene import Scene
    from degense.engine.semantics import TextEncoder
    from degense.engine.semantics.prompts import PromptSet


def clip_options(options: argparse.Namespace) -> ClipOptions:
    from degense.engine.data.readers import ClipOptions

    return ClipOptions(**{item.name: getattr(options, item.name) for item in fields(ClipOptions)})


def chosen_encoder(options: argparse.Namespace) -> TextEncoder | None:
    """The encoder that was named; None when none was. DegenseError when there is none in that place."""
    if options.encoder is None:
        return None
    from degense.engine.semantics.text.towers import encoder_at

    return encoder_at(options.encoder)


def asked_prompts(options: argparse.Namespace) -> PromptSet:
    """What the command line asks. PromptError for a decoder that there is not."""
    from degense.engine.semantics.prompts import PromptSet

    return PromptSet.chosen(options.prompts, options.decoder, options.threshold)


def anonymised_scene(scene: Scene, options: argparse.Namespace) -> Scene:
    """The scene as `--anonymise` and `--cover` want it shown. DegenseError for a cover without the other, or of another size."""
    if options.cover is not None and not options.anonymise:
        raise DegenseError("--cover blacks out a region of what is anonymised; give --anonymise too.")
    if not options.anonymise:
        return scene
    from degense.engine.scene.anonymous import anonymised, read_cover

    return anonymised(scene, None if options.cover is None else read_cover(options.cover, scene.clip_size))


def refuse_cover(options: argparse.Namespace) -> None:
    """DegenseError where Gaussians themselves are written, which hold burnt-in text at any place."""
    if options.cover is not None:
        from degense.engine.scene.anonymous import NOT_COVERED

        raise DegenseError(NOT_COVERED)


def refuse_non_empty(folder: Path) -> None:
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise DegenseError(f"{folder} is not empty; choose another folder, or remove it first (a run goes on with --resume).")
