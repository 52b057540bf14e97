"""Means: of numbers that come one by one, and over seeds with a confidence interval."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from scipy.special import stdtrit


class Mean:
    """Running mean, weighted; None while there is nothing to average."""

    def __init__(self) -> None:
        self.total, self.weight = 0.0, 0.0

    def add(self, value: float | None, weight: float = 1.0) -> None:
        """Count a value; None does not count."""
        if value is not None:
            self.total += float(value) * weight
            self.weight += weight

    @property
    def value(self) -> float | None:
        return self.total / self.weight if self.weight else None


def t_interval(values: Sequence[float], level: float = 0.95) -> tuple[float, float | None]:
    """Mean, and half the width of its two-sided confidence interval: mean ± t · s / √n with Student's t of n − 1 degrees of freedom.

    It takes the values for independent draws of a normal distribution: with three seeds t is 4.3, so only large differences count.

    Parameters
    ----------
    values : sequence of float
        At least one.
    level : float
        In (0, 1).

    Returns
    -------
    (float, float or None)
        None for a single value.
    """
    mean = statistics.fmean(values)
    if len(values) < 2:
        return mean, None
    t = float(stdtrit(len(values) - 1, 0.5 + level / 2))
    return mean, t * statistics.stdev(values) / len(values) ** 0.5
