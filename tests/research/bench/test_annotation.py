"""The bench of carried labels: it corrects the frame that shows most, and scores the others."""

from __future__ import annotations

import numpy as np

from degense.engine.research.benchmarks import annotation
from tests.fakes import MovingWall


def test_the_frame_that_shows_most_is_corrected_and_the_others_scored():
    clip = MovingWall(frames=4, labelled=range(4))
    labels = clip.labels

    def with_a_rare_class(frame: int) -> np.ndarray:
        found = labels(frame)
        if frame == 2:
            found[40:60, 10:40] = 2
        return found

    clip.classes, clip.labels = ("liver", "gallbladder", "grasper"), with_a_rare_class
    assert annotation.most_shown(clip) == 2
    tissues, instruments, confidence, strokes, seconds = annotation._measured(clip, None)
    assert tissues > 0.7
    assert instruments < 0.2  # it is there in no other frame
    assert 0 < confidence <= 1
    assert strokes == 4  # the two unlabelled rows are one region
    assert seconds > 0
