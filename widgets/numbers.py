"""Numbers as axes and read-outs write them."""

from __future__ import annotations

import math


def short(value: float, digits: int = 3) -> str:
    """A number in few characters: `digits` significant ones, plain notation between 0.001 and 99999."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    size = abs(value)
    if 1e-3 <= size < 1e5:
        decimals = max(0, digits - 1 - math.floor(math.log10(size)))
        text = f"{value:.{decimals}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.{digits - 1}e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
