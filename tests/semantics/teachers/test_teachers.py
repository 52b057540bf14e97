"""The label teacher: which frames, which vectors, which pixels."""

from pathlib import Path

import numpy as np
import pytest

from degense.engine.camera import Camera
from degense.engine.clip import UNLABELLED, Clip
from degense.engine.errors import ClipError
from degense.engine.semantics.teachers import LabelTeacher
from degense.engine.semantics.text.encoder import EmbeddedEncoder

CLASSES = ("background", "liver", "foo")


class LabelledClip(Clip):
    """A clip of random label maps on chosen frames."""

    depth_measured = False

    def __init__(self, frames, labelled, seed=0):
        super().__init__("toy", Path("toy"), [Camera(8, 6, 5, 5, 4, 3)] * frames, CLASSES)
        rng = np.random.default_rng(seed)
        self.maps = {i: rng.integers(0, len(CLASSES), (6, 8)).astype(np.uint8) for i in labelled}
        for labels in self.maps.values():
            labels[0, 0] = UNLABELLED
        self.inside = rng.random((6, 8)) < 0.7

    labelled_frames = property(lambda self: sorted(self.maps))

    def labels(self, index):
        return self.maps.get(index)

    def valid(self, index):
        return self.inside

    def frame(self, index):
        return np.zeros((6, 8, 3), np.uint8)

    def depth(self, index):
        return np.zeros((6, 8), np.float32)


def test_targets_match_the_map_pixel_by_pixel():
    clip = LabelledClip(20, [0, 3, 9])
    teacher = LabelTeacher(clip, EmbeddedEncoder())
    for frame in (0, 3):
        vectors, index = teacher.targets(frame)
        assert index.dtype == np.int32
        assert vectors.dtype == np.float32
        for y in range(6):
            for x in range(8):
                label = clip.maps[frame][y, x]
                if label == UNLABELLED or not clip.inside[y, x]:
                    assert index[y, x] == -1
                else:
                    np.testing.assert_array_equal(vectors[index[y, x]], teacher.encoder.encode([CLASSES[label]])[0])


def test_held_out_and_unlabelled_frames_say_nothing():
    clip = LabelledClip(20, [0, 1, 3, 9, 17])
    teacher = LabelTeacher(clip, EmbeddedEncoder())
    assert teacher.frames == [0, 3]
    assert [i for i in range(20) if teacher.targets(i) is not None] == [0, 3]
    assert "2 of 5" in teacher.provenance


def test_a_single_map_is_used_wherever_it_lies():
    teacher = LabelTeacher(LabelledClip(20, [9]), EmbeddedEncoder())
    assert teacher.frames == [9]
    assert teacher.targets(9) is not None


def test_the_clip_is_not_written_to():
    clip = LabelledClip(3, [0])
    before = clip.maps[0].copy()
    LabelTeacher(clip, EmbeddedEncoder()).targets(0)
    np.testing.assert_array_equal(clip.maps[0], before)


def test_errors_are_sentences():
    with pytest.raises(ClipError, match="no label maps"):
        LabelTeacher(LabelledClip(20, []), EmbeddedEncoder())
    with pytest.raises(ClipError, match="held-out"):
        LabelTeacher(LabelledClip(20, [1, 9]), EmbeddedEncoder())
    clip = LabelledClip(20, [0])
    clip.maps[0][2, 2], clip.inside[2, 2] = 77, True
    with pytest.raises(ClipError, match="holds value 77"):
        LabelTeacher(clip, EmbeddedEncoder()).targets(0)
