"""Options of `degense bench reliability`, and what they say."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from degense.engine.errors import DegenseError

NAMES = ("kills", "inputs", "minutes")
#: Options of the benchmark of surgeries that mean the same here, and the names that they have in the campaign.
SHARED = {"scenes": "scenes", "iterations": "iterations", "slots": "slots", "time_limit": "seconds"}


def add_reliability_options(sub: argparse._ArgumentGroup, positive: Callable[[str], int]) -> None:
    """How often, how many, how long; how a number is parsed is the parser's."""
    sub.add_argument("--kills", type=positive, metavar="N", help="ends of programs at random moments (default 200)")
    sub.add_argument("--inputs", type=positive, metavar="N", help="damaged inputs (default 20000)")
    sub.add_argument("--minutes", type=float, metavar="M", help="of work in the window (default 240)")


def campaign_of(options: argparse.Namespace) -> dict[str, Any]:
    """What was said, by name, and the parts that are run."""
    told = {name: getattr(options, name) for name in NAMES} | {own: getattr(options, name) for name, own in SHARED.items()}
    if told["scenes"] is not None and not (told["scenes"].isdecimal() and int(told["scenes"])):
        raise DegenseError(f"--scenes of the campaign is a number of surgeries, not {told['scenes']!r}.")
    return told | {"scenes": told["scenes"] and int(told["scenes"]), "parts": options.names[1:]}
