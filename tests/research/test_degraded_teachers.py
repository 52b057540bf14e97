"""The degraded teacher: 0 changes nothing, each parameter does what it says and no more, and the same frame gets the same answer."""

import numpy as np
import pytest

from degense.engine.errors import DegenseError
from degense.engine.research.degraded_teachers import VLM_LIKE, Degradation, DegradedTeacher, confusable
from degense.engine.semantics.teachers import LabelTeacher, teacher_by_name
from degense.engine.semantics.text.encoder import EmbeddedEncoder
from tests.fakes import MemoryClip, MovingWall


class Stripes(MemoryClip):
    """Five classes in upright stripes of 30 pixels, on every frame."""

    def __init__(self, frames=40):
        super().__init__(frames, 150, 120)
        self.classes = ("liver", "gallbladder", "fat", "grasper", "scissors")

    def labels(self, index):
        return np.repeat(np.arange(5, dtype=np.uint8), 30)[None].repeat(120, 0)

    def valid(self, index):
        valid = np.ones((120, 150), bool)
        valid[:4] = False
        return valid


def degraded(**how):
    return DegradedTeacher(LabelTeacher(Stripes(), EmbeddedEncoder()), Degradation(**how))


def angle(a, b):
    return np.arccos(np.clip((a.astype(np.float64) * b).sum(-1), -1, 1))


def test_nothing_done_is_nothing_changed():
    teacher, plain = degraded(), LabelTeacher(Stripes(), EmbeddedEncoder())
    assert teacher.pixelwise
    for frame in (0, 2, 39):
        (v, i), (w, j) = teacher.targets(frame), plain.targets(frame)
        np.testing.assert_allclose(v, w, atol=1e-6)
        assert np.array_equal(i, j)


def test_held_out_frames_stay_held_out():
    teacher = degraded(patches=10, noise=0.2)
    assert teacher.targets(1) is None
    assert teacher.targets(9) is None
    assert teacher.frames == LabelTeacher(Stripes(), EmbeddedEncoder()).frames


def test_the_same_frame_gets_the_same_answer_and_seeds_differ():
    how = {"patches": 12, "noise": 0.3, "confusion": 0.2, "flicker": 0.2}
    one, two, other = degraded(**how), degraded(**how), degraded(**how, seed=1)
    two.targets(5)
    for part in (0, 1):
        assert np.array_equal(one.targets(7)[part], two.targets(7)[part])
    assert not np.array_equal(one.targets(7)[0], other.targets(7)[0])
    assert not np.array_equal(one.targets(7)[0], one.targets(6)[0])


def test_patches_are_means_over_their_surroundings():
    vectors, index = degraded(patches=10).targets(0)
    truth = LabelTeacher(Stripes(), EmbeddedEncoder()).vectors
    assert vectors.shape == (80, 128)
    assert (index[:4] == -1).all()
    assert index[4, 0] == 0
    assert index[119, 149] == 79
    grid = vectors.reshape(8, 10, -1)
    np.testing.assert_allclose(np.linalg.norm(grid, axis=-1), 1, atol=1e-6)
    # Patches of 15 pixels, two a stripe: next to a border three quarters are the patch's own class.
    mixed = 0.75 * truth[0] + 0.25 * truth[1]
    np.testing.assert_allclose(grid[4, 1], mixed / np.linalg.norm(mixed), atol=1e-6)


def test_noise_has_the_stated_angle():
    clean, noisy = degraded(patches=50), degraded(patches=50, noise=0.4)
    turned = np.concatenate([angle(clean.targets(i)[0], noisy.targets(i)[0]) for i in (0, 2, 3)])
    assert np.sqrt(np.mean(turned**2)) == pytest.approx(0.4, rel=0.05)
    assert np.allclose(np.linalg.norm(noisy.targets(0)[0], axis=1), 1, atol=1e-5)


def test_confusion_leans_towards_the_most_alike_and_takes_that_share_of_regions():
    teacher, plain = degraded(confusion=0.2), LabelTeacher(Stripes(), EmbeddedEncoder())
    twin = confusable(plain.vectors)
    assert twin.tolist()[:2] == [1, 0], "two organs"
    assert twin.tolist()[3:] == [4, 3], "two instruments"
    vectors, _ = teacher.targets(0)
    for c in range(5):
        leaning = 0.8 * plain.vectors[c] + 0.2 * plain.vectors[twin[c]]
        np.testing.assert_allclose(vectors[c], leaning / np.linalg.norm(leaning), atol=1e-6)
    wrong, changes = [], []
    before = None
    for frame in teacher.frames:
        said, truth = teacher.targets(frame)[1], plain.targets(frame)[1]
        mistaken = said != truth
        assert np.isin(said[mistaken], twin).all()
        assert np.array_equal(said[mistaken], twin[truth[mistaken]])
        wrong.append(mistaken[4:].mean())
        if before is not None:
            changes.append((mistaken != before).mean())
        before = mistaken
    assert np.mean(wrong) == pytest.approx(0.2, abs=0.05)
    assert np.mean(changes) < 0.6 * 2 * 0.2 * 0.8, "mistakes last"


def test_flicker_is_independent_from_frame_to_frame():
    teacher, plain = degraded(flicker=0.2), LabelTeacher(Stripes(), EmbeddedEncoder())
    wrong = np.stack([(teacher.targets(i)[1] != plain.targets(i)[1])[4:] for i in teacher.frames])
    assert wrong.mean() == pytest.approx(0.2, abs=0.04)
    assert (wrong[1:] & wrong[:-1]).mean() == pytest.approx(0.04, abs=0.02)
    turned = [angle(teacher.targets(i)[0], plain.vectors) for i in teacher.frames]
    assert np.sqrt(np.mean(np.square(turned))) == pytest.approx(0.2, rel=0.15)


def test_unlabelled_frames_and_pixels_say_nothing():
    clip = MovingWall(10, labelled=[4])
    teacher = DegradedTeacher(LabelTeacher(clip, EmbeddedEncoder()), VLM_LIKE)
    assert [i for i in range(10) if teacher.targets(i) is not None] == [4]
    assert (teacher.targets(4)[1][:2] == -1).all()


def test_it_is_found_by_its_name():
    clip = Stripes()
    assert teacher_by_name("degraded", clip).degradation == VLM_LIKE
    teacher = teacher_by_name("degraded:noise=0.1,patches=7", clip)
    assert (teacher.degradation.noise, teacher.degradation.patches, teacher.degradation.flicker) == (0.1, 7, VLM_LIKE.flicker)
    again = teacher_by_name(teacher.name, clip)
    assert again.degradation == teacher.degradation
    assert "degraded on purpose" in teacher.provenance
    for wrong in (
        "degraded:blur=3",
        "degraded:noise=much",
        "degraded:noise=9",
        "labels:noise=1",
        "degraded:noise=nan",
        "degraded:seed=inf",
    ):
        with pytest.raises(DegenseError):
            teacher_by_name(wrong, clip)
