"""How well the warp layer tells where the model moves tissue otherwise than it truly moved, as a detector: precision against recall."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from degense.engine.clip import Clip

WRONG = 1.0  # pixels: motion that is farther from the true one is false
MOST, BINS = 64.0, 4096  # pixels of warp up to which places are told apart, in so many steps
#: Coarse ranks: unknown, no warp, and edges in steps of `BINS`, each some hundredths larger than the one before.
EDGES = np.unique(np.round(np.geomspace(1, BINS, 241))).astype(np.int64)


class InspectionScores:
    """Scores of the warp layer, frame by frame; long clips need no stacking.

    Protocol
    --------
    Tissue pixels whose true motion in the image is known and where the model shows one. A pixel is wrong where the model's motion since
    the reference frame is more than `WRONG` pixels from the true one. The layer's value ranks the pixels, and what it calls unknown comes
    last. Pixels of equal value, in steps of `MOST` / `BINS` pixels, are told apart by nothing.

    - `average_precision`: Σ (Rₙ − Rₙ₋₁) Pₙ over the ranks n, P precision and R recall; chance gives `wrong`, the share that is wrong.
    - `precision`, `recall`: of the pixels that the layer has a value above `WRONG` for.
    - `unknown`: share of the pixels of which the layer says nothing.
    - `ranked`: how many pixels are right and how many wrong in each coarse rank, from unknown up to the largest warp.
    """

    def __init__(self) -> None:
        self._found = np.zeros((2, BINS + 2), np.int64)  # [right, wrong] × [unknown, no warp, warp in BINS steps]
        self._above = np.zeros(2, np.int64)  # of these with more warp than `WRONG`

    def add(self, warp: np.ndarray, modelled: np.ndarray, true: np.ndarray) -> None:
        """One frame: the layer, float [H, W], NaN where it says nothing; motion of the model and the true one, float [H, W, 2], pixels."""
        off = np.linalg.norm(modelled.astype(np.float64) - true, axis=-1)
        counted = np.isfinite(off)
        value = warp[counted]
        step = np.where(value > 0, np.clip(np.ceil(value * (BINS / MOST)), 1, BINS), 0) + 1
        rank = np.where(np.isfinite(value), step, 0).astype(np.int64)
        for row, which in enumerate((off[counted] <= WRONG, off[counted] > WRONG)):
            self._found[row] += np.bincount(rank[which], minlength=BINS + 2)
            self._above[row] += np.count_nonzero(value[which] > WRONG)

    def result(self) -> dict[str, Any]:
        """The scores of the frames so far; None where no pixel counts, or none is wrong."""
        total, wrong = int(self._found.sum()), int(self._found[1].sum())
        shown = self._above
        coarse = np.add.reduceat(self._found, [0, 1, *(EDGES[:-1] + 1).tolist()], axis=1)
        return {
            "average_precision": average_precision(self._found),
            "wrong": wrong / total if total else None,
            "precision": float(shown[1] / shown.sum()) if shown.any() else None,
            "recall": float(shown[1] / wrong) if wrong else None,
            "unknown": float(self._found[:, 0].sum() / total) if total else None,
            "ranked": dict(zip(("right", "wrong"), coarse.tolist(), strict=True)),
        }


def average_precision(counts: np.ndarray) -> float | None:
    """Σ (Rₙ − Rₙ₋₁) Pₙ of pixels int [2, n], right and wrong, by rank from the lowest up; None where none is wrong."""
    taken = counts[:, ::-1].cumsum(1)  # from the highest rank down
    precision = taken[1] / np.maximum(taken.sum(0), 1)
    gained = np.diff(taken[1], prepend=0)
    return float((gained * precision).sum() / taken[1, -1]) if taken[1, -1] else None


def pooled_average_precision(inspections: Iterable[Mapping[str, Any]]) -> float | None:
    """Average precision over the pixels of many runs together, of which these are the `InspectionScores`, by their coarse ranks."""
    counts = [np.array([one["ranked"]["right"], one["ranked"]["wrong"]]) for one in inspections if "ranked" in one]
    return average_precision(np.sum(counts, 0)) if counts else None


def true_motion(clip: Clip, displacement: np.ndarray, frame: int) -> np.ndarray:
    """Where the tissue of each pixel of a frame was seen at frame 0, less where it is seen now, float64 [H, W, 2], pixels.

    `displacement` is its true offset since then, float [H, W, 3], clip units. NaN where that or the depth is not known.
    """
    camera, depth = clip.cameras[frame], clip.depth(frame).astype(np.float64)
    pixels = camera.pixel_centres()
    here = camera.unproject(pixels, np.where(depth > 0, depth, np.nan))
    return clip.cameras[0].project(here - displacement)[0] - pixels
