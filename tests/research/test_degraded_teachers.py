"""Degraded teachers: each errs as its model says, by strength more, and the same frame gets the same answer."""

import numpy as np
import pytest

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.research import surgeries  # noqa: F401  adds the kind "family"
from degense.engine.research.baselines.masks import teacher_labels, vote
from degense.engine.research.degraded_teachers import Degradation, DegradedTeacher, confusable, without_thin
from degense.engine.semantics.teachers import LabelTeacher, teacher_by_name
from degense.engine.semantics.text.encoder import EmbeddedEncoder
from tests.fakes import MemoryClip, MovingWall

MODELS = ("features", "flips", "drift")
#: Least and greatest share of pixels that agree with the truth, of every strength, on the family's scene.
AGREEMENT = {
    "features": ((0.94, 0.97), (0.9, 0.94), (0.8, 0.89)),
    "flips": ((0.86, 0.93), (0.75, 0.82), (0.6, 0.7)),
    "drift": ((0.88, 0.96), (0.75, 0.88), (0.55, 0.75)),
}


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


@pytest.fixture(scope="module")
def surgery(tmp_path_factory):
    """Seed 1 of the set `develop`: nine classes, three of them instruments."""
    folder = tmp_path_factory.mktemp("family") / "clip"
    make_phantom(folder, PhantomOptions(frames=16, width=160, height=128, kind="family", seed=1))
    return open_clip(folder)


def degraded(model, strength=2, seed=0):
    return DegradedTeacher(Stripes(), EmbeddedEncoder(), Degradation(model, strength, seed))


def wrong(teacher):
    """Pixels called another class, bool [frames, 116, 150]."""
    truth = LabelTeacher(Stripes(), EmbeddedEncoder())
    return np.stack([(teacher.targets(i)[1] != truth.targets(i)[1])[4:] for i in teacher.frames])


@pytest.mark.parametrize("model", MODELS)
def test_strengths_agree_with_the_truth_by_as_much_as_they_should(surgery, model):
    for seed in (0, 1):
        shares = []
        for strength, (least, most) in zip((1, 2, 3), AGREEMENT[model], strict=True):
            said = teacher_labels(
                teacher_by_name(f"degraded:model={model},strength={strength},seed={seed}", surgery), surgery, surgery.train_frames
            )
            shares.append(np.mean([(said[i] == surgery.labels(i))[surgery.valid(i)].mean() for i in surgery.train_frames]))
            assert least < shares[-1] < most
        assert shares == sorted(shares, reverse=True)


@pytest.mark.parametrize("model", MODELS)
def test_the_same_frame_gets_the_same_answer_and_seeds_differ(model):
    one, two, other = degraded(model), degraded(model), degraded(model, seed=1)
    two.targets(5)
    for part in (0, 1):
        assert np.array_equal(one.targets(7)[part], two.targets(7)[part])
    assert any(not np.array_equal(a, b) for a, b in zip(one.targets(7), other.targets(7), strict=True))
    assert any(not np.array_equal(a, b) for a, b in zip(one.targets(7), one.targets(20), strict=True))


@pytest.mark.parametrize("model", MODELS)
def test_unlabelled_pixels_and_held_out_frames_say_nothing(model):
    teacher = degraded(model)
    assert teacher.targets(1) is teacher.targets(9) is None
    assert teacher.frames == LabelTeacher(Stripes(), EmbeddedEncoder()).frames
    clip = MovingWall(10, labelled=[4])
    teacher = DegradedTeacher(clip, EmbeddedEncoder(), Degradation(model))
    assert [i for i in range(10) if teacher.targets(i) is not None] == [4]
    index = teacher.targets(4)[1]
    assert (index[:2] == -1).all()
    assert (index[2:] >= 0).all()


def test_patches_are_means_over_their_surroundings_turned_by_the_noise():
    truth = LabelTeacher(Stripes(), EmbeddedEncoder()).vectors
    teacher = degraded("features", 3)
    assert not teacher.pixelwise
    seen = np.stack([teacher.targets(i)[0] for i in teacher.frames])
    assert seen.shape == (len(teacher.frames), 11 * 14, 128)
    np.testing.assert_allclose(np.linalg.norm(seen, axis=-1), 1, atol=1e-5)
    mean = seen.reshape(len(seen), 11, 14, 128).mean((0, 1))
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    # Patch 1 of 14 lies in the first stripe, which ends at 2.8 patches: three quarters of its field are its own column and those beside it.
    assert mean[1] @ truth[0] > 0.98
    between = mean[2] @ truth[0], mean[2] @ truth[1]
    assert between[0] > between[1] > mean[1] @ truth[1]
    middle = seen.reshape(len(seen), 11, 14, 128)[:, :, 1]
    turned = np.arccos(np.clip(middle @ truth[0], -1, 1))
    assert np.sqrt(np.mean(turned**2)) == pytest.approx(0.7, rel=0.1)


def test_flips_do_not_last_and_a_vote_undoes_them():
    """The stripes stand still, so the commonest of 35 answers is nearly everywhere right."""
    teacher = degraded("flips")
    assert teacher.pixelwise
    mistaken = wrong(teacher)
    assert mistaken.mean() == pytest.approx(0.22, abs=0.04)
    assert (mistaken[1:] & mistaken[:-1]).mean() == pytest.approx(0.22**2, abs=0.02)
    said = teacher_labels(teacher, Stripes(), teacher.frames)
    assert (vote(said, 5) == Stripes().labels(0))[4:].mean() > 0.97


def test_drift_lasts_so_that_a_vote_does_not_undo_it():
    teacher = degraded("drift")
    assert teacher.pixelwise
    mistaken = wrong(teacher)
    assert 0.1 < mistaken.mean() < 0.3
    assert (mistaken[1:] & mistaken[:-1]).mean() > 0.7 * mistaken.mean()
    said = teacher_labels(teacher, Stripes(), teacher.frames)
    assert (vote(said, 5) != Stripes().labels(0))[4:].mean() > 0.02


def test_confusion_is_with_the_class_most_alike():
    twin = confusable(LabelTeacher(Stripes(), EmbeddedEncoder()).vectors)
    assert twin.tolist()[:2] == [1, 0], "two organs"
    assert twin.tolist()[3:] == [4, 3], "two instruments"
    teacher, inner = degraded("drift", 3), np.s_[4:, 10:20]  # away from the boundaries of the first stripe
    said = np.stack([teacher.targets(i)[1][inner] for i in teacher.frames])
    assert set(np.unique(said)) == {0, 1}
    assert (said == 1).mean() == pytest.approx(0.22, abs=0.15)


def test_thin_parts_of_instruments_are_missed():
    index = np.zeros((60, 80), np.int32)
    index[30:] = 1
    index[10:50, 20:23] = 2  # a shaft of 3 pixels
    index[20:40, 50:65] = 2
    found = without_thin(index, [2], 6)
    assert not (found[:, 15:30] == 2).any()
    assert (found[10:29, 20:23] == 0).all()
    assert (found[31:50, 20:23] == 1).all()
    assert (found[22:38, 52:63] == 2).all()


def test_it_is_found_by_its_name():
    clip = Stripes()
    assert teacher_by_name("degraded", clip).degradation == Degradation("features", 2, 0)
    teacher = teacher_by_name("degraded:model=drift,strength=1,seed=3", clip)
    assert teacher.degradation == Degradation("drift", 1, 3)
    assert teacher_by_name(teacher.name, clip).degradation == teacher.degradation
    assert "degraded on purpose" in teacher.provenance


@pytest.mark.parametrize("how", ["noise=0.3", "model=blur", "strength=9", "strength=1.5", "seed=-1", "seed=inf", "model", "flips"])
def test_what_cannot_be_understood_is_refused(how):
    with pytest.raises(DegenseError):
        teacher_by_name(f"degraded:{how}", Stripes())
