"""The mean of numbers that come one by one."""

from __future__ import annotations


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
