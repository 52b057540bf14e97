"""How well masks agree with annotated ones."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from engine.clip import UNLABELLED
from engine.metrics.mean import Mean


def iou(predicted: np.ndarray, truth: np.ndarray) -> float | None:
    """Intersection over union of two masks, bool [H, W]: 0 when just one of them is empty, None when both are."""
    union = np.count_nonzero(predicted | truth)
    return np.count_nonzero(predicted & truth) / union if union else None


def boundary_f(predicted: np.ndarray, truth: np.ndarray, tolerance: float | None = None) -> float | None:
    """Boundary F-score (DAVIS): harmonic mean of the shares of either outline that lie within `tolerance` of the other.

    Outlines are the mask's pixels that touch, by an edge, a pixel outside it; the picture's border makes no outline.

    Parameters
    ----------
    predicted, truth : bool [H, W]
    tolerance : float, optional
        Pixels. Default: 0.008 of the picture's diagonal, as DAVIS.

    Returns
    -------
    float or None
        None when neither mask has an outline, 0 when just one of them has.
    """
    reach = 0.008 * float(np.hypot(*truth.shape)) if tolerance is None else tolerance
    outlines = [_outline(predicted), _outline(truth)]
    if not any(outline.any() for outline in outlines):
        return None
    if not all(outline.any() for outline in outlines):
        return 0.0
    precision, recall = (
        float((cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[outline] <= reach).mean())
        for outline, other in (outlines, outlines[::-1])
    )
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


class MaskScores:
    """Scores of a clip's masks, frame by frame and class by class.

    Protocol
    --------
    - IoU of each class in each frame, over the pixels that the annotation says something about and that are valid.
    - A class that the truth lacks in a frame but that was predicted there scores 0 in it: false positives cost. A class that both lack
      does not count in that frame.
    - `miou` is the mean over classes of the mean over frames. A class that no frame has, in truth or prediction, does not count.
    - `miou_pairs` is the peers' average (SurgTPGS): over all pairs of frame and class that the truth has. False positives on absent
      classes are free there, and a class that is seen often weighs more.
    - `boundary_f` is averaged as `miou`.
    - `floor` of a class is the IoU of the answer "everywhere", averaged over the frames that have the class.

    Parameters
    ----------
    classes : sequence of str
    skipped : sequence of str
        Classes that are not scored, for example "background".
    """

    def __init__(self, classes: Sequence[str], skipped: Sequence[str] = ()):
        self.classes = tuple(classes)
        self._scored = [i for i, name in enumerate(classes) if name not in skipped]
        self._iou, self._boundary, self._floor = ({i: Mean() for i in self._scored} for _ in range(3))
        self._pairs = Mean()

    def add(self, predicted: np.ndarray, truth: np.ndarray, valid: np.ndarray | None = None) -> None:
        """One frame of label maps, uint8 [H, W]; `UNLABELLED` in the prediction is no class, in the truth it is left out."""
        for i in self._scored:
            self.add_mask(i, predicted == i, truth, valid)

    def add_mask(self, index: int, predicted: np.ndarray, truth: np.ndarray, valid: np.ndarray | None = None) -> None:
        """One class in one frame: its predicted mask, bool [H, W] (masks of several classes may overlap), and the true label map."""
        counted = truth != UNLABELLED if valid is None else (truth != UNLABELLED) & valid
        right, guess = (truth == index) & counted, predicted & counted
        score = iou(guess, right)
        self._iou[index].add(score)
        self._boundary[index].add(boundary_f(guess, right))
        if right.any():
            self._pairs.add(score)
            self._floor[index].add(np.count_nonzero(right) / np.count_nonzero(counted))

    def result(self) -> dict[str, float | dict[str, float | None] | None]:
        """`miou`, `miou_pairs`, `boundary_f`, and by class name `iou`, `boundary` and `floor`."""

        def named(means: dict[int, Mean]) -> dict[str, float | None]:
            return {self.classes[i]: mean.value for i, mean in means.items()}

        return {
            "miou": _mean(self._iou),
            "miou_pairs": self._pairs.value,
            "boundary_f": _mean(self._boundary),
            "iou": named(self._iou),
            "boundary": named(self._boundary),
            "floor": named(self._floor),
        }


def _mean(means: dict[int, Mean]) -> float | None:
    over = Mean()
    for mean in means.values():
        over.add(mean.value)
    return over.value


def _outline(mask: np.ndarray) -> np.ndarray:
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    return mask & (cv2.erode(mask.astype(np.uint8), cross, borderType=cv2.BORDER_CONSTANT, borderValue=1) == 0)
