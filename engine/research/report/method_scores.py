"""What a report is made of: one method and the scores of its runs."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from scipy.special import stdtrit


@dataclass(frozen=True)
class MethodScores:
    """One method or run.

    Attributes
    ----------
    name : str
    words : str
        What it is.
    runs : list of dict
        What `engine.metrics.evaluate.evaluate` says of each seed.
    """

    name: str
    words: str
    runs: list[dict[str, Any]]

    @property
    def decoder(self) -> str:
        """The decoder with the largest mIoU over all seeds: the one by which it is compared."""
        decoders = self.runs[0]["miou"]
        return max(decoders, key=lambda decoder: sum(run["miou"][decoder] or 0.0 for run in self.runs))

    @property
    def masks(self) -> list[dict[str, Any]]:
        """Scores of the masks of each seed by the best decoder."""
        return [run["masks"][self.decoder] for run in self.runs]

    def figure(self, read: Callable[[dict[str, Any]], float | None]) -> Figure:
        """What `read` finds in the scores of each seed."""
        return Figure.of([read(run) for run in self.runs])

    def to_json(self) -> dict[str, Any]:
        """Everything, with the mean and the interval of mIoU by the best decoder."""
        miou = self.figure(lambda run: run["miou"][self.decoder])
        return {"words": self.words, "decoder": self.decoder, "miou": miou.to_json(), "runs": self.runs}


@dataclass(frozen=True)
class Figure:
    """A score over seeds: the mean, and half its 95 % interval (`t_interval`); None where there is none."""

    mean: float | None
    half: float | None
    values: tuple[float, ...]

    @classmethod
    def of(cls, values: list[float | None]) -> Figure:
        known = tuple(float(value) for value in values if value is not None)
        mean, half = t_interval(known) if known else (None, None)
        return cls(mean, half, known)

    def text(self, digits: int, factor: float = 1.0) -> str:
        """The mean times `factor`, "81.2 ± 1.1" for several seeds, a dash for none."""
        if self.mean is None:
            return "–"
        return f"{factor * self.mean:.{digits}f}" + (f" ± {factor * self.half:.{digits}f}" if self.half is not None else "")

    def to_json(self) -> dict[str, Any]:
        return {"mean": self.mean, "half_width_95": self.half, "seeds": list(self.values)}


def t_interval(values: Sequence[float], level: float = 0.95) -> tuple[float, float | None]:
    """Mean, and half the width of its two-sided confidence interval: mean ± t · s / √n with Student's t of n − 1 degrees of freedom.

    It takes the values for independent draws of a normal distribution: with three seeds t is 4.3, so only large differences count.
    There must be one value at least; of a single one the second number is None.
    """
    mean = statistics.fmean(values)
    if len(values) < 2:
        return mean, None
    t = float(stdtrit(len(values) - 1, 0.5 + level / 2))
    return mean, t * statistics.stdev(values) / len(values) ** 0.5
