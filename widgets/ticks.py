"""Round numbers for axes and read-outs, and the pieces of curves with gaps. No Qt."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np


def linear_ticks(low: float, high: float, count: int) -> list[float]:
    """At most about `count` multiples of 1, 2 or 5 times a power of ten that lie in [low, high]."""
    if not (math.isfinite(low) and math.isfinite(high)) or high <= low or count < 1:
        return []
    raw = (high - low) / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [i * step for i in range(first, last + 1)]


def log_ticks(low: float, high: float, count: int) -> list[float]:
    """Powers of ten in [low, high], both positive; thinned to about `count`; with their doubles and fives where the range is short."""
    if not 0.0 < low < high or not math.isfinite(high):
        return []
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    stride = max(1, math.ceil((last - first) / max(count, 1)))
    factors = (1, 2, 5) if last - first <= 2 else (1,)
    return [v for e in range(first, last + 1, stride) for f in factors if low <= (v := f * 10.0**e) <= high]


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


def pieces(values: np.ndarray) -> Iterator[np.ndarray]:
    """Indices of each run of finite values, [n] each, one after another."""
    known = np.flatnonzero(np.isfinite(values))
    return (run for run in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if len(run))
