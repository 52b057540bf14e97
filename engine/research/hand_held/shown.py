"""Which pixels of a frame show tissue that the first frame shows too, by the exact truth of a phantom."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from degense.engine.clip import Clip, Truth
from degense.engine.data.synthetic.recording import HIDDEN
from degense.engine.research.baselines.ceiling import undeformed


class ShownTissue(NamedTuple):
    """Pixels of a frame, bool [H, W]."""

    tissue: np.ndarray
    shown: np.ndarray  # of these, the ones whose material point the first frame shows; the others entered later


def shown_at_first(clip: Clip, truth: Truth, frame: int) -> ShownTissue:
    """Follow the point of every tissue pixel back to frame 0: it is shown there if it lies in the view and not behind another surface.

    The pixel's place, unprojected with its exact depth, less its exact displacement is its place at frame 0. `HIDDEN`, in mm, is how far
    behind the depth of its pixel there it may lie. Depth and cameras of the clip must be exact.
    """
    depth, (place, tissue) = clip.depth(frame), undeformed(clip, truth, frame)
    pixel, z = clip.cameras[0].project(place)
    column, row = np.moveaxis(np.floor(pixel).astype(int), -1, 0)
    inside = (column >= 0) & (column < depth.shape[1]) & (row >= 0) & (row < depth.shape[0])
    row, column = np.clip(row, 0, depth.shape[0] - 1), np.clip(column, 0, depth.shape[1] - 1)
    seen = np.isfinite(truth.displacement[0][row, column, 0]) & (z <= clip.depth(0)[row, column] + HIDDEN)
    return ShownTissue(tissue, tissue & inside & seen)
