"""What several commands read from their options."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.data.readers import ClipOptions
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


def refuse_non_empty(folder: Path) -> None:
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise DegenseError(f"{folder} is not empty; choose another folder, or remove it first (a run goes on with --resume).")
