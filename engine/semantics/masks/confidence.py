"""How likely a pixel of a mask is right, by how far it is from a toss-up between the prompt and its best rival."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

BINS = 50  # of the margin, from 0 to 1, in which pixels are counted


@dataclass(frozen=True)
class ConfidenceCurve:
    """The chance that a pixel of a mask truly has what the mask is of, which grows with its margin; linear between points.

    The margin is the similarity with the prompt less that with the best other class, where that is above 0, in [0, 1]. ValueError for
    points that are no curve.
    """

    margins: tuple[float, ...] = (0.0, 1.0)  # growing
    chances: tuple[float, ...] = (0.0, 1.0)  # at these margins, in [0, 1], never falling

    def __post_init__(self) -> None:
        margins, chances = np.array(self.margins, float), np.array(self.chances, float)
        if margins.ndim != 1 or margins.shape != chances.shape or not 1 <= len(margins) <= BINS:
            raise ValueError(f"a curve of confidence has 1 to {BINS} points")
        if not ((np.diff(margins) > 0).all() and (np.diff(chances) >= 0).all() and ((chances >= 0) & (chances <= 1)).all()):
            raise ValueError("a curve of confidence has growing margins and chances from 0 to 1 that never fall")

    def __call__(self, margin: np.ndarray) -> np.ndarray:
        """The chances of margins, float32 of their shape."""
        return np.interp(margin, self.margins, self.chances).astype(np.float32)

    @classmethod
    def fitted(cls, pixels: np.ndarray, margins: np.ndarray, right: np.ndarray) -> ConfidenceCurve:
        """From sums over the pixels of each bin of the margin, float [n]: their number, their margins, and how many are right (which
        an estimate may put above their number). Least squares among curves that never fall; ValueError without pixels."""
        some = pixels > 0
        if not some.any():
            raise ValueError("there are no pixels to fit a curve of confidence to")
        number = pixels[some]
        chances = isotonic_regression(right[some] / number, weights=number).x.clip(0.0, 1.0)
        return cls(tuple((margins[some] / number).tolist()), tuple(chances.tolist()))

    def to_json(self) -> dict[str, list[float]]:
        return {"margins": list(self.margins), "chances": list(self.chances)}

    @classmethod
    def from_json(cls, values: Mapping[str, Sequence[float]]) -> ConfidenceCurve:
        """The inverse of `to_json`. ValueError when it is no curve."""
        try:
            return cls(*(tuple(map(float, values[name])) for name in ("margins", "chances")))
        except (KeyError, TypeError) as error:
            raise ValueError(f"a curve of confidence has margins and chances ({error})") from error


#: Of a run that keeps none of its own: margins are taken for chances.
MARGINS_AS_CHANCES = ConfidenceCurve()
