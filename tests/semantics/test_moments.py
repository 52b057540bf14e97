"""Set operations on masks, and which frames answer a question, against what a person reads off a strip of frames."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.semantics.moments import Moment, expressions, frames_of, mask_of, moments
from degense.engine.vocabulary.questions import Noun, read_question

#: Areas of three things in twelve frames, tenths.
STRIP = {
    "liver": "333333333333",
    "hook_": "001200052000",
    "blood": "000001110000",
}


def answered(text: str) -> str:
    """The frames that answer, as digits in base 12."""
    question = read_question(text)
    areas = {Noun(name.strip("_")): np.array([int(digit) / 10 for digit in row]) for name, row in STRIP.items()}
    assert set(expressions(question)) <= set(areas)
    return "".join("0123456789ab"[frame] for frame in np.flatnonzero(frames_of(question, areas)))


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("hook", "2378"),
        ("when no hook", "014569ab"),
        ("hook when blood", "7"),
        ("hook when no blood", "238"),
        ("liver before hook", "01"),
        ("liver after hook", "9ab"),
        ("liver before blood", "01234"),
        ("liver after first hook", "456789ab"),
        ("liver before last hook", "0123456"),
        ("liver after hook when blood", ""),
        ("first hook", "23"),
        ("last hook", "78"),
        ("first hook when blood", "7"),
        ("last hook before blood", "23"),
        ("hook at its largest", "7"),
        ("hook at its smallest", "2"),
        ("hook before blood when largest", "3"),
        ("liver before blood and after hook", ""),
        ("blood after hook", ""),
        ("hook before liver", ""),
    ],
)
def test_the_frames_that_answer(text, frames):
    assert answered(text) == frames


def test_times_belong_to_what_they_follow():
    assert answered("hook when blood for the first time") == "7"  # the first time that there is blood
    assert answered("hook before blood at its largest") == "3"


def test_moments_are_runs_of_frames_with_their_peaks():
    area = np.array([0, 0.1, 0.3, 0, 0.2, 0, 0, 0.4])
    assert moments(area > 0, area) == (Moment(1, 2, 2, 0.3), Moment(4, 4, 4, 0.2), Moment(7, 7, 7, 0.4))
    assert moments(area > 1, area) == ()
    assert moments(area >= 0, area) == (Moment(0, 7, 7, 0.4),)


def test_set_operations():
    a, b, none = np.array([[True, True, False]]), np.array([[False, True, True]]), np.zeros((1, 3), bool)
    masks = {"liver": a, "fat": b, "hook": none}

    def found(text):
        return mask_of(read_question(text).what, masks)[0].tolist()

    assert found("liver or fat") == [True, True, True]
    assert found("liver and fat") == [True, True, True]
    assert found("liver and hook") == [False, False, False]
    assert found("liver or hook") == [True, True, False]
    assert found("(liver or hook) but not fat") == [True, False, False]
