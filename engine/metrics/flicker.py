"""Flicker of masks over time."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.clip import UNLABELLED


class Flicker:
    """Share of pixels whose label changes from one frame to the next although the tissue in them, and its true label, stay the same.

    Protocol
    --------
    The label map of the previous frame is warped to the current one along the recording's optical flow (nearest pixel). A pixel counts
    where the flow is consistent and comes from inside the picture, both ends are valid, and, where label maps of both frames are known,
    both have the same label. The score is the number of counted pixels with another predicted label over the number of counted pixels,
    over all pairs of frames together. "No label" is a label of its own. Without label maps a true change of label counts as flicker.

    It does not say that masks are right: one that is always empty never flickers.
    """

    def __init__(self) -> None:
        self.changed, self.counted = 0, 0

    def add(
        self,
        previous: np.ndarray,
        current: np.ndarray,
        flow: np.ndarray,
        consistent: np.ndarray,
        true_previous: np.ndarray | None = None,
        true_current: np.ndarray | None = None,
    ) -> None:
        """One pair of neighbouring frames: label maps uint8 [H, W], predicted and, if known, true ones (`UNLABELLED` where they are not).

        `flow` float32 [H, W, 2] leads from the current frame to the previous one, in pixels. `consistent` bool [H, W] is where the flow is
        consistent and both ends are valid.
        """
        before, inside = warped(previous, flow)
        counted = consistent & inside
        if true_previous is not None and true_current is not None:
            truth, _ = warped(true_previous, flow)
            counted = counted & (truth == true_current) & (true_current != UNLABELLED)
        self.changed += int(np.count_nonzero(counted & (before != current)))
        self.counted += int(np.count_nonzero(counted))

    @property
    def value(self) -> float | None:
        """In [0, 1]; None when no pixel counts."""
        return self.changed / self.counted if self.counted else None


def warped(labels: np.ndarray, flow: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Label maps [H, W] looked up where a flow leads (nearest pixel), and where that lies inside the picture, bool [H, W]."""
    height, width = labels.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x, y = x + flow[..., 0].astype(np.float32), y + flow[..., 1].astype(np.float32)
    inside = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)
    x, y = np.where(inside, np.rint(x), 0), np.where(inside, np.rint(y), 0)
    return cv2.remap(labels, x.astype(np.float32), y.astype(np.float32), cv2.INTER_NEAREST), inside
