"""Last touches to a binary mask: specks removed, holes closed that are none of another thing."""

from __future__ import annotations

import cv2
import numpy as np

#: Components smaller than this share of the picture (33 pixels at 640 × 512) are specks, unless nothing larger is there.
SPECK = 1e-4
#: Enclosed holes smaller than this share of the picture are closed whatever they show.
TINY_HOLE = 1e-4
#: Larger enclosed holes are closed up to this share, if similarity reaches half the threshold there and no other class fits better.
LARGEST_HOLE = 1e-2


def without_specks(mask: np.ndarray) -> np.ndarray:
    """The mask, bool [H, W], without components (8-connected) below `SPECK`; the largest component always stays."""
    count, labels, areas = _components(mask, 8)
    if count <= 2:
        return mask
    keep = areas >= SPECK * mask.size
    keep[1 + int(np.argmax(areas[1:]))] = True
    keep[0] = False
    return keep[labels]


def without_holes(mask: np.ndarray, similarity: np.ndarray, threshold: float, rivals: np.ndarray | None = None) -> np.ndarray:
    """The mask, bool [H, W], with enclosed holes (4-connected, not touching the picture's edge) closed.

    An instrument in front of an organ makes a true hole, a highlight on the organ a false one. A hole is closed when it is tiny,
    or when it is at most `LARGEST_HOLE`, the mean similarity in it reaches half the threshold,
    and the mean of the rivals (float [H, W], the best other class) does not exceed it.
    """
    count, labels, areas = _components(~mask, 4)
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    enclosed = np.ones(count, bool)
    enclosed[0] = False
    enclosed[edge] = False
    enclosed &= areas <= LARGEST_HOLE * mask.size
    if not enclosed.any():
        return mask
    close = enclosed & (areas < TINY_HOLE * mask.size)
    inside = enclosed[labels]
    owner = labels[inside]
    mean = np.bincount(owner, similarity[inside], count) / np.maximum(areas, 1)
    fits = mean >= 0.5 * threshold
    if rivals is not None:
        fits &= np.bincount(owner, rivals[inside], count) / np.maximum(areas, 1) <= mean
    close |= enclosed & fits
    return mask | close[labels]


def _components(mask: np.ndarray, connectivity: int) -> tuple[int, np.ndarray, np.ndarray]:
    """Number of labels (0 is outside of the mask), label of each pixel, area of each label."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=connectivity)
    return count, labels, stats[:, cv2.CC_STAT_AREA]
