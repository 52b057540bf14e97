"""What the motion around a place says of it: how it goes on there, how much it varies, and which share of it the place had before."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from degense.engine.motion.flow import sample

REACHES = (0.02, 0.06, 0.18)  # of the width: σ within which neighbours speak for a place whose own motion is not seen,
ENOUGH = 0.1  # where so much of what is within it is seen
RIDGE = 0.3  # of the window's σ², which is added to the variance of places: how much a slope must show to be believed
COARSE = 3  # pixels of σ at least that a window keeps on a coarser grid
CELL = 4  # pixels: side of the cells that former motion is kept in
ALIKE = 0.03  # of the width: σ of the window in which tissue has one share
AS_AROUND = 1.0  # pixels², summed over frames: what a place did counts as much as that it moves as what is around with so much of it
FORMER = 32  # frames, evenly spread, that are asked at most


def from_around(flow: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flow [H, W, 2] completed where it is not `seen`, and its spread, float32 [H, W]: see `Observed`.

    The flow changes at a steady rate in a Gaussian window, the smallest of `REACHES` in which enough is seen. By weighted least squares of
    what is seen there, with x the place over the width, x̄ and f̄ the window's means and C the covariance of x plus `RIDGE` σ² I,

        f(x) = f̄ + (x − x̄)ᵀ C⁻¹ cov(x, f),    spread² = v (1 + (x − x̄)ᵀ C⁻¹ (x − x̄)),

    v the variance that this leaves; beyond what is seen the spread grows with the distance.
    """
    height, width = seen.shape
    found = np.where(seen[..., None], flow, 0).astype(np.float32)
    spread = np.where(seen, 0, np.nan).astype(np.float32)
    shown = np.dstack([found, (found**2).sum(-1), seen.astype(np.float32)])
    x, y = _places(width, height, height / width)
    for reach in REACHES:
        missing = np.isnan(spread)
        if not missing.any():
            break
        shrink = max(1, int(reach * width / COARSE))  # the window is wide: a coarser grid holds it as well
        small = max(1, width // shrink), max(1, height // shrink)
        fits = _fitted(cv2.resize(shown, small, interpolation=cv2.INTER_AREA), height / width, reach)
        seen_share, variance, *plane = (cv2.resize(values, (width, height), interpolation=cv2.INTER_LINEAR) for values in fits)
        fill = missing & (seen_share > ENOUGH)
        for c in range(2):
            found[..., c][fill] = (plane[c] + plane[2 + c] * x + plane[4 + c] * y)[fill]
        spread[fill] = np.sqrt(variance[fill])
    return found, spread


def _places(width: int, height: int, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the cells of a grid over an image whose height is `aspect` widths: x float32 [w] and y float32 [h, 1], in widths."""
    x, y = ((np.arange(n, dtype=np.float32) + np.float32(0.5)) / np.float32(n) for n in (width, height))
    return x, y[:, None] * np.float32(aspect)


def _fitted(shown: np.ndarray, aspect: float, reach: float) -> list[np.ndarray]:
    """The fits of `from_around` in windows of one `reach`, of means [h, w, 4] of flow, its square and the weight, all 0 where not seen.

    The weight of what is seen, the square of the spread, and of both directions of flow the value at x = 0 and the slopes in x and y;
    eight times float32 [h, w].
    """
    height, width, _ = shown.shape
    fx, fy, square, seen = np.moveaxis(shown, -1, 0)
    x, y = _places(width, height, aspect)
    products = [seen, *(seen * of for of in (x, y, x * x, x * y, y * y)), fx, fy, x * fx, x * fy, y * fx, y * fy, square]
    sums = np.stack([cv2.GaussianBlur(values, (0, 0), reach * width) for values in products])
    weight, ridge = sums[0], RIDGE * reach**2
    mx, my, mxx, mxy, myy, *of_flow, msquare = sums[1:] / np.maximum(weight, 1e-6)
    flow, x_flow, y_flow = np.stack(of_flow).reshape(3, 2, height, width)
    xx, xy, yy = mxx - mx * mx + ridge, mxy - mx * my, myy - my * my + ridge
    with_x, with_y, determinant = x_flow - mx * flow, y_flow - my * flow, xx * yy - xy * xy
    slope_x, slope_y = (with_x * yy - with_y * xy) / determinant, (with_y * xx - with_x * xy) / determinant
    explained = slope_x * with_x + slope_y * with_y + ridge * (slope_x**2 + slope_y**2)
    left = np.maximum(msquare - (flow**2 + explained).sum(0), 0)
    dx, dy = x - mx, y - my
    variance = left * (1 + (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant)
    return [weight, variance, *(flow - slope_x * mx - slope_y * my), *slope_x, *slope_y]


class _Shown(NamedTuple):
    """What a frame showed of motion from the reference frame on, in cells of that."""

    flow: np.ndarray  # float32 [h, w, 2], reference → frame; pixels
    known: np.ndarray  # bool [h, w]; flow is of the same tissue
    seen: np.ndarray  # bool [h, w]; it is, on texture that pins it down


class Shares:
    """Which share of the motion around it a place had in the frames before, in which it showed its own.

    Tissue that stood still while all around it breathed goes on so when blood or a burn hides how it moves; the motion around alone
    would not know. Frames come in the order of time, from the one after the reference on, and each is told of by those before it only:
    what is said of it does not depend on which frames were asked for.
    """

    def __init__(self) -> None:
        self._shown: list[_Shown] = []
        self._found: dict[int, np.ndarray] = {}  # α and κ of a frame, in cells of the reference

    def add(self, out: np.ndarray, known: np.ndarray, seen: np.ndarray) -> None:
        """The next frame: flow reference → frame [H, W, 2] in pixels; where it is of the same tissue, and on texture, bool [H, W] both."""
        height, width = known.shape
        cells = max(1, width // CELL), max(1, height // CELL)
        found = np.dstack([np.where(known[..., None], out, 0), known, seen]).astype(np.float32)
        mean = cv2.resize(found, cells, interpolation=cv2.INTER_AREA)
        self._shown.append(_Shown(mean[..., :2] / np.maximum(mean[..., 2:3], 1e-3), mean[..., 2] > 0.5, mean[..., 3] > 0.5))

    def of(self, number: int, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """α, the share, and κ, the part of the spread around that was left beside it, of a frame's pixels, float32 [H, W] both.

        `number` counts frames from the reference, which is 0; `way` [H, W, 2] is where its pixels were then, as far as is known. With r a
        place's motion in a former frame, and s and v the same by what was seen around it both then and now, and its spread (`from_around`),

            α = (G(Σ r·s) + c) / (G(Σ s·s) + c),    κ² = min(1, (G(Σ ‖r − α s‖²) + c) / (G(Σ v²) + c)),    c = `AS_AROUND`,

        sums over the former frames in which the place was known, of places that are not seen now; G a Gaussian window. Both are 1, the
        motion around as it is, where nothing was known before.
        """
        height, width = way.shape[:2]
        if number < 2:
            return np.ones((height, width), np.float32), np.ones((height, width), np.float32)
        if number not in self._found:
            self._found[number] = self._learnt(number)
        there = sample(cv2.resize(self._found[number], (width, height), interpolation=cv2.INTER_LINEAR), way)
        found = np.where(np.isfinite(there), there, 1).astype(np.float32)
        return found[..., 0], found[..., 1]

    def _learnt(self, number: int) -> np.ndarray:
        """α and κ of `of`, in cells of the reference, float32 [h, w, 2]."""
        now = self._shown[number - 1].seen
        former = np.unique(np.linspace(0, number - 2, min(FORMER, number - 1)).round().astype(int))
        total = np.zeros((*now.shape, 4), np.float32)
        for shown in (self._shown[i] for i in former):
            near, spread = from_around(shown.flow, shown.seen & now)
            counts = shown.known & ~now & np.isfinite(spread)
            sums = [(a * b).sum(-1) for a, b in ((shown.flow, near), (near, near), (shown.flow, shown.flow))]
            total += np.where(counts[..., None], np.dstack([*sums, np.square(spread)]), 0)
        together, alone, own, varied = np.moveaxis(cv2.GaussianBlur(total, (0, 0), ALIKE * now.shape[1]), -1, 0)
        share = (together + AS_AROUND) / (alone + AS_AROUND)
        left = np.maximum(own - 2 * share * together + share**2 * alone, 0)  # Σ ‖r − α s‖²
        return np.dstack([share, np.sqrt(np.minimum((left + AS_AROUND) / (varied + AS_AROUND), 1))])
