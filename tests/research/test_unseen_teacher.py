"""The unseen teacher: how far it agrees with the truth, that its mistakes last, that thin instruments are missed, and what it refuses."""

import numpy as np
import pytest

from degense.engine.errors import DegenseError
from degense.engine.research.unseen_teacher import LASTS, MISSED, WRONG, UnseenTeacher
from degense.engine.semantics.teachers import LabelTeacher, teacher_by_name
from degense.engine.semantics.text.encoder import EmbeddedEncoder
from tests.fakes import MemoryClip


class Halves(MemoryClip):
    """Liver and fat side by side, with a grasper of 4 pixels across them, in 400 frames of 160 × 120 pixels."""

    def __init__(self):
        super().__init__(400, 160, 120)
        self.classes = ("liver", "fat", "grasper")

    def labels(self, index):
        labels = np.repeat(np.uint8([0, 1]), 80)[None].repeat(120, 0)
        labels[60:64] = 2
        return labels

    def valid(self, index):
        valid = np.ones((120, 160), bool)
        valid[:4] = False
        return valid


@pytest.fixture(scope="module")
def said():
    teacher = UnseenTeacher("unseen", Halves(), EmbeddedEncoder())
    return np.stack([teacher.targets(i)[1] for i in teacher.frames])


def test_regions_are_mistaken_as_often_and_as_long_as_they_should_be(said):
    """A third of the names drawn at random is right."""
    tissue = np.concatenate([said[:, 20:48], said[:, 72:]], 1)
    truth = np.repeat([0, 1], 80)
    mistaken = tissue != truth
    assert mistaken.mean() == pytest.approx(WRONG * 2 / 3, abs=0.03)
    follows = (mistaken[1:] & mistaken[:-1]).mean() / mistaken.mean()
    assert 1 - 1.6 / LASTS < follows < 1 - 0.5 / LASTS  # of the training frames an eighth has none before it
    assert (tissue[:, :12, :16] == tissue[:, :1, :1]).all()  # a region is mistaken as a whole


def test_thin_instruments_are_missed_in_some_frames_and_invalid_pixels_say_nothing(said):
    assert (said[:, :4] == -1).all()
    assert (said[:, 4:] >= 0).all()
    seen = (said[:, 60:64] == 2).mean((1, 2)) > 0.4  # a mistaken region may call anything a grasper
    assert 1 - seen.mean() == pytest.approx(MISSED, abs=0.08)


def test_the_same_seed_says_the_same_and_held_out_frames_are_left_out():
    clip = Halves()
    one, two, other = (teacher_by_name(name, clip) for name in ("unseen", "unseen:seed=0", "unseen:seed=1"))
    assert one.targets(1) is None
    assert one.frames == LabelTeacher(clip, EmbeddedEncoder()).frames
    assert np.array_equal(one.targets(7)[1], two.targets(7)[1])
    assert any(not np.array_equal(one.targets(i)[1], other.targets(i)[1]) for i in (7, 10, 12, 14))


def test_an_unknown_wording_is_refused():
    with pytest.raises(DegenseError, match="unseen:seed=0"):
        UnseenTeacher("unseen:strength=2", Halves(), EmbeddedEncoder())
