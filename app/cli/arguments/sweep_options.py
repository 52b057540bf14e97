"""Options of `degense bench surgeries` and `degense bench clips`, and what they say."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

Parse = Callable[[str], Any]
NAMES = (
    *("which", "scenes", "size", "frames", "methods", "teachers", "depths", "preset", "iterations", "max_gaussians"),
    *("slots", "time_limit", "no_baselines", "tables_only", "held_out_maps"),
)


def add_sweep_options(sub: argparse._ArgumentGroup, setting: Parse, size: Parse, positive: Parse) -> None:
    """The options; how settings, sizes and numbers are parsed is the parser's."""
    sub.add_argument("--set", dest="which", metavar="NAME", help="develop (default), or report, on which nothing is chosen")
    sub.add_argument("--scenes", metavar="N|SEED,...", help="how many of the set (default 6), or which: 3,7 (one: 3,)")
    sub.add_argument("--size", type=size, metavar="WxH", help="picture size (default 320x256)")
    sub.add_argument("--frames", type=positive, metavar="N", help="of each clip (default 48)")
    sub.add_argument(
        "--methods", metavar="NAME,...", help="systems as of compare, and coupled (default degense,degensegs,surgtpgs,coupled)"
    )
    sub.add_argument(
        "--teachers", metavar="NAME,...", help="labels (default), none, degraded:model=flips,strength=2 (degraded: all nine), unseen"
    )
    sub.add_argument("--depth", dest="depths", metavar="NAME,...", help="exact (default), noisy, none")
    sub.add_argument("--preset", metavar="NAME", help="quick, balanced (default) or best")
    sub.add_argument("--iterations", type=positive, metavar="N", help="not on report, nor the next two")
    sub.add_argument("--max-gaussians", type=positive, metavar="N")
    sub.add_argument(
        "--set-option", type=setting, action="append", default=[], dest="settings", metavar="NAME=VALUE", help="as --set of train"
    )
    sub.add_argument("--slots", type=positive, metavar="N", help="trainings at a time, round robin over the GPUs")
    sub.add_argument("--time-limit", type=float, metavar="S", help="begin nothing new after so many seconds")
    sub.add_argument("--no-baselines", action="store_true", help="leave out what needs no scene")
    sub.add_argument(
        "--held-out-maps",
        type=Path,
        metavar="FOLDER",
        help="of clips: CLIP.json (COCO) maps further frames, for scoring alone",
    )
    sub.add_argument("--tables-only", action="store_true", help="make the tables of what is there")


def sweep_of(options: argparse.Namespace) -> dict[str, Any]:
    """What was said, by name."""
    from degense.app.features.train.job import parse_settings

    return {name: getattr(options, name) for name in NAMES} | {"settings": parse_settings(tuple(options.settings))}
