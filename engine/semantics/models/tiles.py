"""Square tiles that cover a frame at several scales, and one feature map of all of them."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

OVERLAP = 0.25  # of a tile's side that neighbours share at least


def tiled(rgb: np.ndarray, side: int, scales: int, model: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The feature map float32 [h', w', C] of a frame uint8 [H, W, 3], averaged over tiles and scales, as fine as the finest tiles' maps.

    Tiles are as high as the frame, then half as high, a third, …, down to 1 / `scales`. The model takes pictures uint8 [n, side, side, 3]
    and gives float32 [n, h, w, C].
    """
    height, width = rgb.shape[:2]
    total = weight = None
    for scale in range(scales, 0, -1):
        boxes = _boxes(height, width, scale)
        pictures = [
            cv2.resize(rgb[y : y + s, x : x + s], (side, side), interpolation=cv2.INTER_AREA if s > side else cv2.INTER_CUBIC)
            for y, x, s in boxes
        ]
        maps = model(np.stack(pictures))
        if total is None or weight is None:
            cell = boxes[0][2] / maps.shape[1]  # pixels of the frame
            shape = max(1, round(height / cell)), max(1, round(width / cell))
            total, weight = np.zeros((*shape, maps.shape[-1]), np.float32), np.zeros(shape, np.float32)
        rows, columns = total.shape[:2]
        for (y, x, s), values in zip(boxes, maps, strict=True):
            top, bottom = round(y / height * rows), max(round((y + s) / height * rows), round(y / height * rows) + 1)
            left, right = round(x / width * columns), max(round((x + s) / width * columns), round(x / width * columns) + 1)
            fitted = [cv2.resize(channel, (right - left, bottom - top)) for channel in np.moveaxis(values, -1, 0)]
            total[top:bottom, left:right] += np.stack(fitted, -1)
            weight[top:bottom, left:right] += 1
    assert total is not None
    assert weight is not None
    return total / weight[..., None]


def _boxes(height: int, width: int, scale: int) -> list[tuple[int, int, int]]:
    """(top, left, side) of square tiles that cover a frame, spread evenly."""
    side = max(1, min(height, width) // scale)
    tops, lefts = _starts(height, side), _starts(width, side)
    return [(top, left, side) for top in tops for left in lefts]


def _starts(length: int, side: int) -> list[int]:
    count = 1 if length == side else int(np.ceil((length - side) / (side * (1 - OVERLAP)))) + 1
    return [round(place) for place in np.linspace(0, length - side, count)]
