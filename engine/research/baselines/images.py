"""Pictures without any scene: one colour, and the nearest training frame."""

from __future__ import annotations

from typing import Any

import numpy as np

from degense.engine.clip import Clip
from degense.engine.metrics.averages import Mean
from degense.engine.metrics.image import ImageScores
from degense.engine.research.baselines.masks import nearest


def image_baselines(clip: Clip) -> dict[str, dict[str, Any]]:
    """Scores of "constant colour" (the mean of the valid pixels of the training frames) and "nearest training frame" on held-out frames."""
    constant, copied = ImageScores(), ImageScores()
    colour = mean_colour(clip)
    for frame in clip.test_frames:
        recorded, valid = clip.frame(frame), clip.valid(frame)
        constant.add(np.broadcast_to(colour, recorded.shape).astype(np.uint8), recorded, valid)
        copied.add(clip.frame(nearest(frame, clip.train_frames)), recorded, valid)
    return {"constant colour": constant.result(), "nearest training frame": copied.result()}


def mean_colour(clip: Clip) -> np.ndarray:
    """Mean RGB of the valid pixels of the training frames, rounded, 0 to 255, float [3]."""
    channels = [Mean() for _ in range(3)]
    for frame in clip.train_frames:
        pixels = clip.frame(frame)[clip.valid(frame)]
        for channel, mean in enumerate(channels):
            if len(pixels):
                mean.add(float(pixels[:, channel].mean()), len(pixels))
    return np.rint([mean.value or 0.0 for mean in channels])
