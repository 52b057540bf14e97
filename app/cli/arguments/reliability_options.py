"""Options of `degense bench reliability`, and what they say."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

NAMES = ("kills", "inputs", "minutes")


def add_reliability_options(sub: argparse._ArgumentGroup, positive: Callable[[str], int]) -> None:
    """How often, how many, how long; how a number is parsed is the parser's."""
    sub.add_argument("--kills", type=positive, metavar="N", help="ends of programs at random moments (default 200)")
    sub.add_argument("--inputs", type=positive, metavar="N", help="damaged inputs (default 20000)")
    sub.add_argument("--minutes", type=float, metavar="M", help="of work in the window (default 240)")


def campaign_of(options: argparse.Namespace) -> dict[str, Any]:
    """What was said, by name, and the parts that are run."""
    return {name: getattr(options, name) for name in NAMES} | {"parts": options.names[1:]}
