"""How values on the command line are read. Each raises ArgumentTypeError, or ValueError, for what it cannot read."""

from __future__ import annotations

import argparse


def positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def setting(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals and name != "help":
        raise argparse.ArgumentTypeError(f"{text!r} is no setting such as flow=10")
    return name, value


def size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 320x256")
    return int(width), int(height)


def frame_range(text: str) -> tuple[int | None, int | None]:
    if text == "all":
        return None, None
    first, colon, last = text.partition(":")
    if not colon or not all(part == "" or part.isdigit() for part in (first, last)):
        raise argparse.ArgumentTypeError(f"{text!r} is no range such as 0:40")
    return (int(first) if first else None), (int(last) if last else None)


def labelled_or_range(text: str) -> tuple[int | None, int | None] | str:
    return text if text == "labelled" else frame_range(text)


def number_range(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    try:
        return float(low), float(high)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no range such as 0:2.5") from None


def share(text: str) -> tuple[int, int]:
    index, slash, count = text.partition("/")
    if not (slash and index.isdigit() and count.isdigit() and int(index) < int(count)):
        raise argparse.ArgumentTypeError(f"{text!r} is no share such as 0/4")
    return int(index), int(count)
