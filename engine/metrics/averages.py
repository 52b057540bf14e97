"""Means of numbers, where some may be None."""

from __future__ import annotations

from collections.abc import Iterable


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


def mean(values: Iterable[float | None]) -> float | None:
    """The mean of what is not None; None when nothing is left."""
    over = Mean()
    for value in values:
        over.add(value)
    return over.value
