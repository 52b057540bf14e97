"""Numbers along one side of a plot, and the pixels that they lie at."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from degense.widgets.numbers import ticks

#: Larger values are gaps: the range could not be computed.
LARGEST = 1e100
#: Share of the range that is left free beyond its ends.
ROOM = 0.04


@dataclass(frozen=True)
class Scale:
    """From `low` at pixel `first` to `high` at pixel `last`; both are powers of ten where it is logarithmic."""

    low: float
    high: float
    first: float
    last: float
    log: bool = False

    @classmethod
    def of(cls, values: Iterable[np.ndarray], first: float, last: float, log: bool = False) -> Scale:
        """The scale that holds all finite values, with some room beyond them."""
        known = np.concatenate([np.zeros(0), *values])
        known = known[np.isfinite(known) & (known > 0)] if log else known[np.isfinite(known)]
        if not len(known):
            return cls(0.0, 1.0, first, last, log)
        low, high = (float(math.log10(end) if log else end) for end in (known.min(), known.max()))
        room = ROOM * (high - low) or max(0.5 * abs(low), 0.5)
        return cls(low - room, high + room, first, last, log)

    def pixels(self, values: np.ndarray) -> np.ndarray:
        """Where values lie; NaN stays NaN."""
        with np.errstate(divide="ignore", invalid="ignore"):
            placed = np.log10(values) if self.log else np.asarray(values, float)
        return self.first + (placed - self.low) / (self.high - self.low) * (self.last - self.first)

    def value(self, pixel: float) -> float:
        """What lies at a pixel."""
        placed = self.low + (pixel - self.first) / (self.last - self.first) * (self.high - self.low)
        return float(10.0**placed if self.log else placed)

    def ticks(self, room: float) -> list[float]:
        """Round numbers, each with so many pixels for itself. Logarithmic: powers of ten, with their doubles and fives in short ranges."""
        most = max(2, int(abs(self.last - self.first) / room))
        if not self.log:
            return ticks(self.low, self.high, most)
        factors = (1, 2, 5) if self.high - self.low <= 2 else (1,)
        stride = max(1, math.ceil((self.high - self.low) / most))
        decades = range(math.floor(self.low), math.ceil(self.high) + 1, stride)
        return [factor * 10.0**decade for decade in decades for factor in factors if self.low <= decade + math.log10(factor) <= self.high]
