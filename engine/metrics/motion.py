"""How well displacement is recovered, against exact truth."""

from __future__ import annotations

import numpy as np

from degense.engine.metrics.averages import Mean


class MotionScores:
    """Scores of a clip's displacement, frame by frame; long clips need no stacking.

    Protocol
    --------
    Everything compares norms, pixel by pixel, in scene units, both from the same reference frame. Tissue pixels are those where the truth
    is finite. Pixels that the model does not cover (prediction not finite) are left out; `displacement_coverage` says how many are left.

    - `displacement_error`: mean of |‖predicted‖ − ‖true‖| over tissue pixels of all frames.
    - `displacement_correlation`: Pearson's correlation of ‖predicted‖ and ‖true‖ over the same pixels, all frames pooled.
    - `recovered_share`: Σ min(‖predicted‖, ‖true‖) / Σ ‖true‖ over the same pixels. Motion where there is none, and motion beyond the
      true one, earn nothing here; they show in the error.
    - `spurious_displacement`: mean of max(‖predicted‖ − ‖true‖, 0) in `cautery`, where tissue changes colour: motion that explains a
      change of colour. Where charred tissue is static, that is the mean ‖predicted‖.
    - `false_motion`: mean ‖predicted‖ on other static tissue (‖true‖ ≤ `static`).
    - `largest_displacement`: the largest ‖true‖.
    - `true_displacement`: mean ‖true‖, which is the error of the answer "nothing moves".
    - `displacement_error_revealed`, `displacement_error_uncertain`: the error over pixels whose displacement the recording reveals, and
      over those that are marked as a guess. `spurious_displacement_revealed`: the spurious one over the former.

    "Nothing moves" wins `spurious_displacement` and `false_motion`: never show these without correlation and recovered share.
    A score without pixels, and a correlation with a constant, is None.
    Tissue that moved no farther than `static`, in scene units, counts as static: the phantom is in mm, and a tenth of one is below what
    anyone can see.
    """

    def __init__(self, static: float = 0.1):
        self.static = static
        self._error, self._spurious, self._false, self._true, self._covered = (Mean() for _ in range(5))
        self._revealed, self._guessed, self._spurious_revealed = Mean(), Mean(), Mean()
        self._shared = self._largest = 0.0
        self._moments = np.zeros(6)  # n, mean p, mean t, Σ(p − p̄)², Σ(t − t̄)², Σ(p − p̄)(t − t̄)

    def add(self, predicted: np.ndarray, truth: np.ndarray, cautery: np.ndarray, uncertain: np.ndarray | None = None) -> None:
        """One frame: predicted norms [H, W] or vectors [H, W, 3], not finite where the model shows nothing, and true vectors [H, W, 3].

        The truth is NaN where no tissue is seen. `cautery` bool [H, W]; `uncertain` bool [H, W] are pixels marked as a guess.
        """
        guess, right = _norm(predicted), np.linalg.norm(truth.astype(np.float64), axis=-1)
        if guess.shape != right.shape or cautery.shape != right.shape:
            raise ValueError(f"shapes differ: predicted {predicted.shape}, truth {truth.shape}, cautery {cautery.shape}")
        tissue = np.isfinite(right)
        counted = tissue & np.isfinite(guess)
        if tissue.any():
            self._covered.add(float(counted[tissue].mean()), float(np.count_nonzero(tissue)))
        p, t, burnt = guess[counted], right[counted], cautery[counted]
        error, spurious = np.abs(p - t), np.maximum(p - t, 0)
        _add_mean(self._error, error)
        _add_mean(self._spurious, spurious[burnt])
        if uncertain is not None:
            guessed = uncertain[counted]
            _add_mean(self._revealed, error[~guessed])
            _add_mean(self._guessed, error[guessed])
            _add_mean(self._spurious_revealed, spurious[burnt & ~guessed])
        _add_mean(self._true, t)
        _add_mean(self._false, p[~burnt & (t <= self.static)])
        self._largest = max(self._largest, float(t.max(initial=0)))
        self._shared += float(np.minimum(p, t).sum())
        self._pool(p, t)

    def result(self) -> dict[str, float | None]:
        """The scores of the frames so far."""
        _, _, _, pp, tt, pt = self._moments
        moved = self._true.total
        return {
            "displacement_error": self._error.value,
            "displacement_correlation": float(pt / np.sqrt(pp * tt)) if pp > 0 and tt > 0 else None,
            "recovered_share": self._shared / moved if moved > 0 else None,
            "spurious_displacement": self._spurious.value,
            "spurious_displacement_revealed": self._spurious_revealed.value,
            "false_motion": self._false.value,
            "true_displacement": self._true.value,
            "largest_displacement": self._largest if moved > 0 else None,
            "displacement_coverage": self._covered.value,
            "displacement_error_revealed": self._revealed.value,
            "displacement_error_uncertain": self._guessed.value,
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
