"""What a label map looks like over a picture: colour, contour and hatching, so that no class is told by its colour alone."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from degense.engine.annotation.edits import LabelClass
from degense.engine.clip import UNLABELLED

FILL, STRIPE, CONTOUR = 90, 170, 255  # opacity of the inside, of hatching, of the outline
PERIOD, WIDTH = 10, 2  # pixels of hatching
DASH = 3  # pixels: outlines of proposals are dashed
#: The hatching of the classes, in turn: neighbours in the list differ.
PATTERNS = ("plain", "rising", "falling", "level", "upright", "crossed")


def hatching(pattern: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Where pixels (x, y), int [...], lie on the lines of a pattern, bool [...]."""
    rising, falling = (x + y) % PERIOD < WIDTH, (x - y) % PERIOD < WIDTH
    lines = {
        "plain": np.zeros(np.broadcast_shapes(x.shape, y.shape), bool),
        "rising": rising,
        "falling": falling,
        "level": y % PERIOD + 0 * x < WIDTH,
        "upright": x % PERIOD + 0 * y < WIDTH,
        "crossed": rising | falling,
    }
    return lines[pattern]


def label_overlay(
    labels: np.ndarray, classes: Sequence[LabelClass], box: tuple[slice, slice] | None = None, proposed: bool = False
) -> np.ndarray:
    """Labels uint8 [H, W] as colours to lay over the frame, uint8 RGBA [h, w, 4]; unlabelled pixels are clear.

    `box` (rows, columns) is the part that is wanted, by default all; `proposed` labels wait for an answer and get a dashed outline.
    """
    rows, columns = box or (slice(0, labels.shape[0]), slice(0, labels.shape[1]))
    top, left = rows.start, columns.start
    around = cv2.copyMakeBorder(
        labels[max(0, top - 1) : rows.stop + 1, max(0, left - 1) : columns.stop + 1],
        int(top == 0),
        int(rows.stop == labels.shape[0]),
        int(left == 0),
        int(columns.stop == labels.shape[1]),
        cv2.BORDER_REPLICATE,
    )
    inner = around[1:-1, 1:-1]
    table = np.zeros((256, 4), np.uint8)
    table[: len(classes), :3] = [kind.colour for kind in classes] or np.zeros((0, 3))
    table[: len(classes), 3] = FILL
    out = table[inner]
    alpha = out[..., 3]
    x, y = np.arange(left, columns.stop)[None], np.arange(top, rows.stop)[:, None]
    for index, pattern in enumerate(PATTERNS[1:], 1):
        members = np.zeros(256, bool)
        members[index : len(classes) : len(PATTERNS)] = True
        mask = members[inner]
        if mask.any():
            alpha[mask & hatching(pattern, x, y)] = STRIPE
    edge = (inner != around[:-2, 1:-1]) | (inner != around[2:, 1:-1]) | (inner != around[1:-1, :-2]) | (inner != around[1:-1, 2:])
    if proposed:
        edge &= (x + y) // DASH % 2 == 0
    alpha[edge & (inner != UNLABELLED)] = CONTOUR
    return out
