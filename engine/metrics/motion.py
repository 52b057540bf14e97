"""How well displacement is recovered, against exact truth."""

from __future__ import annotations

from typing import Any

import numpy as np

from degense.engine.clip import Clip
from degense.engine.metrics.averages import Mean
from degense.engine.scene.uncertainty import SURE

STATIC = 0.001  # of the scene's depth: tissue that moved no farther counts as static, a tenth of a millimetre 100 mm away
OBSERVABILITY = (0.0, 0.25, 0.5, 0.75, 1.0)  # edges of the bins of `displacement_error_by_observability`
#: Lengths that are also given as shares of the scene's depth, so that scenes of any size can be pooled.
RELATIVE = ("displacement_error", "false_motion", "spurious_displacement", "spurious_displacement_static", "true_displacement")


def scene_depth(clip: Clip) -> float | None:
    """Median known depth of the valid pixels of frame 0, clip units; None where none is known."""
    depth = clip.depth(0)[clip.valid(0)]
    known = depth[np.isfinite(depth) & (depth > 0)]
    return float(np.median(known)) if known.size else None


class MotionScores:
    """Scores of a clip's displacement, frame by frame; long clips need no stacking.

    Protocol
    --------
    Everything compares norms, pixel by pixel, in scene units, both from the same reference frame. Tissue pixels are those where the truth
    is finite. Every one that shows a displacement counts; `displacement_coverage` says which share of them does.

    - `displacement_error`: mean of |‖predicted‖ − ‖true‖| over tissue pixels of all frames.
    - `displacement_correlation`: Pearson's correlation of ‖predicted‖ and ‖true‖ over the same pixels, all frames pooled.
    - `recovered_share`: Σ min(‖predicted‖, ‖true‖) / Σ ‖true‖ over the same pixels. Motion where there is none, and motion beyond the
      true one, earn nothing here; they show in the error.
    - `spurious_displacement`: mean of max(‖predicted‖ − ‖true‖, 0) in `cautery`, where tissue changes colour: motion that explains a
      change of colour. `spurious_displacement_static`: the same where such tissue is static.
    - `false_motion`: the same on other static tissue. What counts as static may have moved a little: that much motion is not false.
    - `true_displacement`: mean ‖true‖, which is the error of the answer "nothing moves". `largest_displacement`: the largest ‖true‖.
    - `…_revealed`: the same scores over pixels that are not marked as a guess, in frames with marks; `displacement_error_uncertain`: the
      error over those that are. `displacement_error_by_observability`: by bins of the displayed motion observability, the error
      next to the true displacement and the share of pixels.
    - `sure_kept`: of the pixels that are not marked as a guess, the share that is well recovered, with an error of at most the share `SURE`
      of the scene's depth, as the window says of nine in ten. `good_guesses`: of the well recovered pixels, the share that is marked.
    - `displacement_scale`: `depth`, and `…_relative`: a length as share of it.

    "Nothing moves" wins `spurious_displacement` and `false_motion`: never show these without correlation, error and recovered share.
    A score without pixels, and a correlation with a constant, is None.

    `depth` is that of the scene, in scene units (`scene_depth`). Tissue that moved no farther than the share `static` of it counts as
    static: an absolute threshold would call half of a scene that is measured in decimetres static. None: nothing but standing still is
    static.
    """

    def __init__(self, depth: float | None, static: float = STATIC):
        self.depth, self.static = depth, static * (depth or 0.0)
        self._all, self._revealed = _Tally(), _Tally()
        self._guessed, self._tissue, self._marked = Mean(), 0, 0  # pixels of tissue, of all frames and of those with marks
        self._well = np.zeros((2, 2), np.int64)  # pixels of frames with marks, [poorly, well recovered] × [sure, marked as a guess]
        self._by_observability = [(Mean(), Mean()) for _ in OBSERVABILITY[1:]]

    def add(
        self,
        predicted: np.ndarray,
        truth: np.ndarray,
        cautery: np.ndarray,
        uncertain: np.ndarray | None = None,
        observability: np.ndarray | None = None,
    ) -> None:
        """One frame: predicted norms [H, W] or vectors [H, W, 3], not finite where the model shows nothing, and true vectors [H, W, 3].

        The truth is NaN where no tissue is seen. `cautery` bool [H, W]; `uncertain` bool [H, W] are pixels marked as a guess;
        `observability` float [H, W] is displayed beside them.
        """
        guess, right = _norm(predicted), np.linalg.norm(truth.astype(np.float64), axis=-1)
        if guess.shape != right.shape or cautery.shape != right.shape:
            raise ValueError(f"shapes differ: predicted {predicted.shape}, truth {truth.shape}, cautery {cautery.shape}")
        tissue = np.isfinite(right)
        counted = tissue & np.isfinite(guess)
        self._tissue += int(np.count_nonzero(tissue))
        self._all.add(guess[counted], right[counted], cautery[counted], self.static)
        if uncertain is not None:
            sure, unsure = counted & ~uncertain, counted & uncertain
            self._marked += int(np.count_nonzero(tissue))
            self._revealed.add(guess[sure], right[sure], cautery[sure], self.static)
            _add_mean(self._guessed, np.abs(guess - right)[unsure])
            well = np.abs(guess - right)[counted] <= SURE * (self.depth or 0.0)
            self._well += np.bincount(2 * well + uncertain[counted], minlength=4).reshape(2, 2)
        if observability is not None:
            bins = np.digitize(observability, OBSERVABILITY[1:-1])
            for index, (error, moved) in enumerate(self._by_observability):
                inside = counted & (bins == index) & np.isfinite(observability)
                _add_mean(error, np.abs(guess - right)[inside])
                _add_mean(moved, right[inside])

    def result(self) -> dict[str, Any]:
        """The scores of the frames so far."""
        scores = self._all.result(self._tissue)
        revealed = {f"{name}_revealed": value for name, value in self._revealed.result(self._marked).items()}
        relative = {f"{name}_relative": _ratio(scores[name], self.depth) for name in RELATIVE}
        (_, _), (well_sure, well_guessed) = self._well.tolist()
        guessed = {
            "displacement_error_uncertain": self._guessed.value,
            "displacement_error_by_observability": self._observability(),
            "sure_kept": _ratio(well_sure, int(self._well[:, 0].sum())),
            "good_guesses": _ratio(well_guessed, well_sure + well_guessed),
        }
        return scores | revealed | guessed | relative | {"displacement_scale": self.depth}

    def _observability(self) -> dict[str, dict[str, float | None]]:
        """By bin, as "0.25-0.5": `error`, `true_displacement`, and `share` of the pixels; empty when no observability was given."""
        total = sum(error.weight for error, _ in self._by_observability)
        return {
            f"{low:g}-{high:g}": {"error": error.value, "true_displacement": moved.value, "share": error.weight / total}
            for low, high, (error, moved) in zip(OBSERVABILITY, OBSERVABILITY[1:], self._by_observability, strict=False)
            if total
        }


class _Tally:
    """The scores of a set of pixels."""

    def __init__(self) -> None:
        self._error, self._spurious, self._spurious_static, self._false, self._true = (Mean() for _ in range(5))
        self._shared = self._largest = 0.0
        self._moments = np.zeros(6)  # n, mean p, mean t, Σ(p − p̄)², Σ(t − t̄)², Σ(p − p̄)(t − t̄)

    def add(self, p: np.ndarray, t: np.ndarray, burnt: np.ndarray, static: float) -> None:
        """Predicted and true norms [n], where tissue changes its colour, bool [n], and the motion up to which it is static."""
        still = t <= static
        beyond = np.maximum(p - t, 0)
        _add_mean(self._error, np.abs(p - t))
        _add_mean(self._spurious, beyond[burnt])
        _add_mean(self._spurious_static, beyond[burnt & still])
        _add_mean(self._false, beyond[~burnt & still])
        _add_mean(self._true, t)
        self._largest = max(self._largest, float(t.max(initial=0)))
        self._shared += float(np.minimum(p, t).sum())
        self._pool(p, t)

    def result(self, tissue: int) -> dict[str, float | None]:
        """The scores; of so many pixels of tissue these are a share."""
        _, _, _, pp, tt, pt = self._moments
        moved = self._true.total
        return {
            "displacement_error": self._error.value,
            "displacement_correlation": float(pt / np.sqrt(pp * tt)) if pp > 0 and tt > 0 else None,
            "recovered_share": self._shared / moved if moved > 0 else None,
            "spurious_displacement": self._spurious.value,
            "spurious_displacement_static": self._spurious_static.value,
            "false_motion": self._false.value,
            "true_displacement": self._true.value,
            "largest_displacement": self._largest if moved > 0 else None,
            "displacement_coverage": self._error.weight / tissue if tissue else None,
        }

    def _pool(self, p: np.ndarray, t: np.ndarray) -> None:
        """Merge a frame's moments into the pool (Chan et al., 1983), which loses no digits as running sums of squares would."""
        if not p.size:
            return
        n, mean_p, mean_t, pp, tt, pt = self._moments
        m, new_p, new_t = float(p.size), float(p.mean()), float(t.mean())
        dp, dt, both = new_p - mean_p, new_t - mean_t, n + m
        part = n * m / both
        self._moments = np.array(
            [
                both,
                mean_p + dp * m / both,
                mean_t + dt * m / both,
                pp + _spread(p, p) + dp * dp * part,
                tt + _spread(t, t) + dt * dt * part,
                pt + _spread(p, t) + dp * dt * part,
            ]
        )


def _spread(a: np.ndarray, b: np.ndarray) -> float:
    """Σ (a − ā)(b − b̄); exactly 0 when either is constant."""
    if a.min() == a.max() or b.min() == b.max():
        return 0.0
    return float(((a - a.mean()) * (b - b.mean())).sum())


def _norm(values: np.ndarray) -> np.ndarray:
    values = values.astype(np.float64)
    return np.linalg.norm(values, axis=-1) if values.ndim == 3 else values


def _add_mean(mean: Mean, values: np.ndarray) -> None:
    if values.size:
        mean.add(float(values.mean()), float(values.size))


def _ratio(value: float | None, by: float | None) -> float | None:
    return value / by if value is not None and by else None
