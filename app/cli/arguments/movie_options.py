"""The options of `degense movie`."""

from __future__ import annotations

import argparse
from pathlib import Path

from degense.app.cli.arguments.argument_types import size

LAYERS = "up to four, side by side; `recording` is what was recorded; `rgb+displacement:0.5` lays one over the other, half opaque"


def add_movie_options(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("run_folder", type=Path, metavar="RUN", help="run folder")
    sub.add_argument("--out", type=Path, required=True, metavar="FILE", help="movie to write (.mp4)")
    sub.add_argument("--layers", default="rgb", metavar="NAME,...", help=LAYERS)
    sub.add_argument("--size", type=size, metavar="WxH", help="of each picture (default: of the clip)")
    sub.add_argument("--fps", type=float, metavar="N", help="frames a second (default: of the clip; 25 along a path)")
    sub.add_argument("--cameras", type=Path, metavar="PATH", help="a camera path that the window saved (.json), to fly along")
    sub.add_argument("--time", default="kept", metavar="WHICH", help="of a flight: the instants kept with its cameras (default), or whole")
    sub.add_argument("--titled", action="store_true", help="with the names of the layers and their colour bars")
