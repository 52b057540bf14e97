"""The options that hide who is shown."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_anonymise_options(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--anonymise", action="store_true", help="leave out names of files and folders, and where things come from")
    sub.add_argument(
        "--cover",
        type=Path,
        metavar="MASK",
        help="with --anonymise: a picture, not black where text is burnt into the clip, which is blacked out",
    )
