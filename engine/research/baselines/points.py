"""Points followed without any scene: "nothing moves", and optical flow alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.files.point_files import KnownPoints
from degense.engine.metrics.tracks import score_followed
from degense.engine.motion.points import following_pixels
from degense.engine.progress import finish


def point_baselines(clip: Clip, known: KnownPoints) -> dict[str, dict[str, Any]]:
    """Scores, as `tracks`, of "nothing moves" and of "optical flow alone" (`degense track` of a clip) for points that people marked."""
    pixels, seen = finish(following_pixels(clip.frame, len(clip), known.queries))
    still = np.repeat(known.queries[:, None, 1:], len(clip), axis=1)
    answers = {"nothing moves": (still, np.ones_like(seen)), "optical flow alone": (pixels, seen)}
    return {name: {"tracks": score_followed(*answer, known, clip.size[0]) | {"followed": 1.0}} for name, answer in answers.items()}
