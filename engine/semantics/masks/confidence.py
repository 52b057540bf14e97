"""How likely pixels of a mask are right, by how far they are from a toss-up between the prompt and its best rival, and objects by size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

BINS = 50  # of the margin, from 0 to 1, in which pixels are counted
PRIOR_OBJECTS = 2.0  # of each size, that are as right as their pixels say
LARGEST_SPECK = 1e-2  # of the picture: what is larger is never left out of a mask


@dataclass(frozen=True)
class ConfidenceCurve:
    """The chance that a pixel of a mask truly has what the mask is of, which grows with its margin; linear between points.

    The margin is the similarity with the prompt less that with the best other class, where that is above 0, in [0, 1]. An object is a
    connected part of a mask; small ones are less right than their pixels. ValueError for points that are no curve.
    """

    margins: tuple[float, ...] = (0.0, 1.0)  # growing
    chances: tuple[float, ...] = (0.0, 1.0)  # at these margins, in [0, 1], never falling
    sizes: tuple[float, ...] = (0.0,)  # of objects, log₂ of the share of the picture; growing
    discounts: tuple[float, ...] = (1.0,)  # the factor of the mean chance of an object of these sizes, in [0, 1], never falling
    least: float = 0.0  # share of the picture: objects that are smaller are oftener wrong than right

    def __post_init__(self) -> None:
        for points, values in ((self.margins, self.chances), (self.sizes, self.discounts)):
            where, what = np.array(points, float), np.array(values, float)
            if where.ndim != 1 or where.shape != what.shape or not 1 <= len(where) <= BINS:
                raise ValueError(f"a curve of confidence has 1 to {BINS} points")
            if not ((np.diff(where) > 0).all() and (np.diff(what) >= 0).all() and ((what >= 0) & (what <= 1)).all()):
                raise ValueError("a curve of confidence has growing margins and chances from 0 to 1 that never fall")
        if not 0 <= self.least <= LARGEST_SPECK:
            raise ValueError(f"objects of up to {LARGEST_SPECK} of the picture are left out, not of {self.least}")

    def __call__(self, margin: np.ndarray) -> np.ndarray:
        """The chances of margins, float32 of their shape."""
        return np.interp(margin, self.margins, self.chances).astype(np.float32)

    def of_objects(self, said: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """The shares of objects that are expected to be right, float [n], from the means of their pixels' chances and from the shares
        of the picture that they cover, float [n] both."""
        return said * np.interp(np.log2(shares), self.sizes, self.discounts)

    def of_mask(self, chances: np.ndarray, mask: np.ndarray) -> float:
        """The share of a mask bool [H, W] that is expected to be right: the mean over its pixels of what its objects are, by the chances
        of its pixels float [H, W]; 0 for an empty mask."""
        if not mask.any():
            return 0.0
        _, parts = cv2.connectedComponents(mask.astype(np.uint8))
        sizes, sums = (np.bincount(parts[mask], weight)[1:] for weight in (None, chances[mask].astype(np.float64)))
        return float((self.of_objects(sums / sizes, sizes / mask.size) * sizes).sum() / sizes.sum())

    @classmethod
    def fitted(cls, pixels: np.ndarray, margins: np.ndarray, right: np.ndarray) -> ConfidenceCurve:
        """From sums over the pixels of each bin of the margin, float [n]: their number, their margins, and how many are right (which
        an estimate may put above their number). Least squares among curves that never fall; ValueError without pixels."""
        some = pixels > 0
        if not some.any():
            raise ValueError("there are no pixels to fit a curve of confidence to")
        number = pixels[some]
        chances = _never_falling(right[some] / number, number).clip(0.0, 1.0)
        return cls(tuple((margins[some] / number).tolist()), tuple(chances.tolist()))

    def with_objects(self, shares: np.ndarray, said: np.ndarray, right: np.ndarray) -> ConfidenceCurve:
        """The same curve with what objects add, from the shares of the picture that some cover, the means of their pixels' chances, and
        the shares of them that are right (of an estimate, which may be above 1), float [n] each.

        In each octave of size, right over said, both with `PRIOR_OBJECTS`; least squares among what never falls with size, and never
        above 1: pixels of large objects have their chances already.
        """
        octaves, place = np.unique(np.floor(np.log2(shares)), return_inverse=True)
        if not 1 <= len(octaves) <= BINS:
            return self
        number, said_sum, right_sum = (np.bincount(place, weight) for weight in (None, said, right))
        usual = PRIOR_OBJECTS * said_sum / number
        expected = _never_falling((right_sum + usual) / (number + PRIOR_OBJECTS), number)
        ratio = (right_sum + usual) / np.maximum(said_sum + usual, 1e-9)
        discounts = _never_falling(ratio, said_sum + 1e-9).clip(0.0, 1.0)
        wrong = octaves[expected < 0.5]
        least = min(2.0 ** (wrong[-1] + 1), LARGEST_SPECK) if len(wrong) else 0.0
        return replace(self, sizes=tuple((octaves + 0.5).tolist()), discounts=tuple(discounts.tolist()), least=float(least))

    def to_json(self) -> dict[str, Any]:
        points = {name: list(getattr(self, name)) for name in ("margins", "chances", "sizes", "discounts")}
        return {**points, "least": self.least}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> ConfidenceCurve:
        """The inverse of `to_json`; before decision 49 nothing is said of objects. ValueError when it is no curve."""
        try:
            names = ("margins", "chances", *(("sizes", "discounts") if "sizes" in values else ()))
            return cls(**{name: tuple(map(float, values[name])) for name in names}, least=float(values.get("least", 0.0)))
        except (KeyError, TypeError) as error:
            raise ValueError(f"a curve of confidence has margins and chances ({error})") from error


#: Of a run that keeps none of its own: margins are taken for chances.
MARGINS_AS_CHANCES = ConfidenceCurve()


def _never_falling(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The values that never fall and are nearest to those given, in weighted squares; float [n] all."""
    from scipy.optimize import isotonic_regression  # 12 MB, which an opened run that only reads its curve does not need

    return isotonic_regression(values, weights=weights).x
