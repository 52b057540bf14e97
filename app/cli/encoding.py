"""`--encoder`: who says what words mean, when that is not the embedded vocabulary or what a run keeps."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from degense.engine.semantics import TextEncoder


def chosen_encoder(options: argparse.Namespace) -> TextEncoder | None:
    """The encoder that was named; None when none was. DegenseError when there is none in that place."""
    if options.encoder is None:
        return None
    from degense.engine.semantics.text.towers import encoder_at

    return encoder_at(options.encoder)
