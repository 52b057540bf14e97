"""What can be said about a clip on the command line."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import get_args

from degense.app.cli.arguments.argument_types import positive
from degense.engine.data.clip_options import LAYOUTS, ClipOptions, MaskMeans, PoseAxes, Poses


def add_clip_options(sub: argparse.ArgumentParser) -> None:
    sub.set_defaults(**asdict(ClipOptions()))
    sub.add_argument("--layout", metavar="NAME", help=f"{', '.join(LAYOUTS[:-1])} or {LAYOUTS[-1]} (default: detected)")
    sub.add_argument("--mask-means", choices=get_args(MaskMeans), help="what white means in the clip's masks (default: detected)")
    sub.add_argument(
        "--poses",
        choices=get_args(Poses),
        help="whether the camera moves: as the clip says, else decided from its frames (auto, default); no; yes, and find out how",
    )
    sub.add_argument("--pose-axes", choices=get_args(PoseAxes), help="axes of a moving camera's poses (default: llff)")
    sub.add_argument("--labels", metavar="FOLDER", help="read label maps from its labels/ and classes.json instead of the clip's own")
    sub.add_argument("--start", type=int, metavar="N", help="first frame used of a video file")
    sub.add_argument("--stride", type=positive, metavar="N", help="use each Nth frame of a video file")
    sub.add_argument(
        "--max-frames",
        type=positive,
        metavar="N",
        help="most frames used of a video file (default %(default)s)",
    )
    sub.add_argument("--focal", type=float, metavar="PX", help="focal length in pixels (default: from the clip; `info` shows it)")
