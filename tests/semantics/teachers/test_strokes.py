"""From a few scribbles to soft label maps of all training frames."""

import numpy as np
import pytest

from degense.engine.errors import ClipError
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.teachers import StrokeTeacher
from degense.engine.semantics.teachers.teacher import soft_targets
from tests.semantics.teachers.stroked import HONEST, StrokedClip


def likeliest(teacher, answer):
    """Label map of an answer, −1 where nothing is said."""
    vectors, index = answer
    best = np.array(teacher.classes)[(vectors @ teacher.vectors.T).argmax(1)]
    return np.where(index >= 0, best[index], -1)


def test_a_few_strokes_reach_every_training_frame():
    clip = StrokedClip(HONEST)
    teacher = StrokeTeacher(clip, EmbeddedEncoder())
    answers = dict(teacher.compute(teacher.frames))
    assert sorted(answers) == clip.train_frames
    for frame, answer in answers.items():
        said, truth, valid = likeliest(teacher, answer), clip.truth_labels(frame), clip.valid(frame)
        assert (said[~valid] == -1).all()
        assert np.allclose(np.linalg.norm(answer[0], axis=1), 1, atol=1e-6)
        for value in (0, 1, 2):
            union = valid & ((said == value) | (truth == value))
            assert (said == value)[union].sum() > 0.8 * (truth == value)[valid].sum(), f"class {value} is lost in frame {frame}"
            assert ((said == value) & (truth == value))[union].mean() > 0.8, f"class {value} in frame {frame}"


def test_held_out_frames_are_never_looked_at():
    clip = StrokedClip({**HONEST, 9: [(3, (100, 40), (110, 60))]})
    teacher = StrokeTeacher(clip, EmbeddedEncoder())
    assert teacher.sources == [0]
    assert 3 not in teacher.classes  # "fat" was scribbled on a held-out frame only
    list(teacher.compute(teacher.frames))
    assert not clip.read & set(clip.test_frames)


def test_classes_nobody_scribbled_are_never_said():
    teacher = StrokeTeacher(StrokedClip(HONEST), EmbeddedEncoder())
    fat = teacher.encoder.encode(["fat"])[0]
    for _, (vectors, _) in teacher.compute([0, 2]):
        assert (vectors @ fat).max() < 0.5


@pytest.mark.parametrize(("contrast", "tolerance"), [(1.0, 0.05), (0.15, 0.05), (0.0, 0.2)])
def test_it_is_as_sure_as_it_is_right(contrast, tolerance):
    """Halves of strokes lie near each other, so where looks tell nothing it is surer than it should be, but not by much."""
    clip = StrokedClip(HONEST, contrast=contrast)
    teacher = StrokeTeacher(clip, EmbeddedEncoder())
    p, valid = teacher._calibrated(0)[teacher._regions[0].of], clip.valid(0)
    right = np.array(teacher.classes)[p.argmax(-1)] == clip.truth_labels(0)
    assert p.max(-1)[valid].mean() == pytest.approx(right[valid].mean(), abs=tolerance)


def test_strokes_of_a_later_frame_serve_the_frames_around_it():
    later = {6: [(v, (a[0] + 18 * (v == 1), a[1]), (b[0] + 18 * (v == 1), b[1])) for v, a, b in HONEST[0]]}
    clip = StrokedClip({**HONEST, **later})
    teacher = StrokeTeacher(clip, EmbeddedEncoder())
    assert "2 frames (0, 6)" in teacher.provenance
    [(_, answer)] = teacher.compute([8])
    valid = clip.valid(8)
    assert (likeliest(teacher, answer) == clip.truth_labels(8))[valid].mean() > 0.9


def test_it_says_what_it_needs():
    with pytest.raises(ClipError, match="no strokes"):
        StrokeTeacher(StrokedClip({}), EmbeddedEncoder())
    with pytest.raises(ClipError, match="fewer than two classes"):
        StrokeTeacher(StrokedClip({0: [(0, (10, 10), (20, 20))]}), EmbeddedEncoder())


def test_settings_follow_the_strokes_and_nothing_random():
    one, same = (StrokeTeacher(StrokedClip(HONEST), EmbeddedEncoder()).settings for _ in range(2))
    other = StrokeTeacher(StrokedClip({0: HONEST[0][:-1]}), EmbeddedEncoder()).settings
    assert one == same
    assert one != other


def test_soft_targets_keep_the_proportions_of_the_two_likeliest():
    random = np.random.default_rng(0)
    vectors = np.eye(4, dtype=np.float32)
    p = random.dirichlet(np.full(4, 0.5), (20, 30))
    known = random.random((20, 30)) < 0.8
    mixed, index = soft_targets(p, vectors, known)
    assert ((index >= 0) == known).all()
    assert len(np.unique(index[known])) == len(mixed)
    got = mixed[index[known]]
    two = np.where(p >= np.sort(p, -1)[..., -2:-1], p, 0)[known]
    two /= two.sum(1, keepdims=True)
    shares = got / got.sum(1, keepdims=True)
    assert np.abs(shares - two).max() < 1 / 16 + 1e-6  # half a step of the eight between 0.5 and 1
