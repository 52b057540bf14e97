"""The bench of carried labels: it corrects the frame that shows most, and scores the others."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.annotation.edits import Proposal
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.research.benchmarks import annotation, carrying, correcting
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


def test_carrying_says_what_is_flagged_and_how_well_it_knows():
    sure = np.array([0.95] * 20)
    assert carrying.calibration_error(sure, np.array([1.0] * 19 + [0.0])) == pytest.approx(0, abs=1e-6)
    assert carrying.calibration_error(sure, np.zeros(20)) == pytest.approx(0.95)
    told = np.array([[1, 1, 1, 0, 0], [1, 1, 0, 0, 1], [1, 1, 0, 1, 0], [1, 1, 0, 1, 0]], np.float32)
    row = carrying.figures(told)
    assert (row["new"], row["flagged"], row["missed"], row["right"], row["error"]) == pytest.approx((60, 200 / 3, 50, 60, 0))


def test_what_enters_after_the_labelled_frame_is_not_named(tmp_path):
    """The bar of the project, on a phantom that is not of the family: grasper and hook enter, tissue chars."""
    make_phantom(tmp_path, PhantomOptions(frames=16, width=128, height=96), lambda fraction, words: None)
    row = carrying.figures(carrying.carried(open_clip(tmp_path)))
    assert row["new"] > 1
    assert row["flagged"] > 90
    assert row["missed"] < 3
    assert row["error"] < 5


def test_frames_are_corrected_by_their_expected_error_or_evenly(tmp_path):
    """Every frame corrected is right; the doubtful one is asked for next; what is said of confidence is counted once a pixel."""
    assert [correcting.evenly(count, 12, {}, []) for count in (1, 2, 3)] == [[6], [3, 9], [2, 6, 10]]
    said = {2: (0.9, 0.0), 5: (0.8, 0.3), 7: (0.75, 0.0), 8: (0.75, 0.0)}
    proposals = {frame: Proposal(b"", (1, 1), *numbers) for frame, numbers in said.items()}
    assert correcting.most_doubtful(2, 12, proposals, [6]) == [6, 5]
    make_phantom(tmp_path, PhantomOptions(frames=4, width=64, height=48, seed=3), lambda fraction, words: None)
    told: dict[str, list[np.ndarray]] = {"pixels": [], "objects": [], "frames": []}
    first, *_, last = correcting.corrected(open_clip(tmp_path), (1, 2, 4), correcting.most_doubtful, told)
    assert 0.3 < first < last == pytest.approx(1)
    assert [len(told["frames"]), sum(part.shape[1] for part in told["pixels"])] <= [6, 6 * 64 * 48]


def test_the_reliability_is_that_of_each_bin():
    told = {"pixels": np.array([[0.95] * 10 + [0.55] * 10, [1.0] * 10 + [0.0] * 10])}
    *bins, error = correcting._reliability("", told).rows
    assert [(row["bin"], row["count"], row["right"]) for row in bins] == [("50 to 60", 10, 0.0), ("90 to 100", 10, 100.0)]
    assert error["said"] == pytest.approx(100 * (0.5 * 0.05 + 0.5 * 0.55))
