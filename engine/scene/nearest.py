"""The nearest of many places.

OpenCV's k-d tree, which is exact and in memory already: the first import of `scipy.spatial` takes 25 MB (docs/decisions/0059).
"""

from __future__ import annotations

import cv2
import numpy as np

KD_TREE, LEAF = 4, 16  # FLANN_INDEX_KDTREE_SINGLE: the only one of FLANN's indices for low dimensions that is exact


def nearest(places: np.ndarray, queries: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows int64 [M, k] of the `count` places [N, d] nearest to each query [M, d], the nearest first, and distances float64 [M, k].

    k is at most N, which is at least 1. All are finite; distances are computed in float32.
    """
    index = cv2.flann.Index(np.ascontiguousarray(places, np.float32), {"algorithm": KD_TREE, "leaf_max_size": LEAF})
    everywhere = {"checks": -1, "eps": 0.0, "sorted": True}
    rows, squares = index.knnSearch(np.ascontiguousarray(queries, np.float32), min(count, len(places)), params=everywhere)
    return rows.astype(np.int64), np.sqrt(squares, dtype=np.float64)
