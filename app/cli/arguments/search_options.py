"""Options of `degense search`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


def add_search_options(sub: argparse.ArgumentParser, positive: Callable[[str], int]) -> None:
    sub.add_argument("folder", type=Path, metavar="DIR", help="folder with runs")
    sub.add_argument("prompts", nargs="+", metavar="QUESTION", help="as for query")
    sub.add_argument("--json", type=Path, metavar="FILE", help="write the moments there too")
    sub.add_argument("--thumbnails", type=Path, metavar="FOLDER", help="write there a small picture of each moment that is listed")
    sub.add_argument("--limit", type=positive, default=100, metavar="N", help="most moments that are listed (default 100)")
    sub.add_argument("--open", action="store_true", help="open the runs that the index cannot answer for, which takes as long as query")
    sub.add_argument("--as-is", action="store_true", help="ask the index as it is: new and changed runs are not looked for")
    sub.add_argument("--anonymise", action="store_true", help="number the runs instead of naming them")
