"""What a costly teacher said is kept by content, whole, and within a limit."""

import os
import time
import zipfile

import numpy as np
import pytest

from degense.engine.errors import Cancelled, DegenseError
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.teachers import LabelTeacher, with_cached_targets
from degense.engine.semantics.teachers import target_cache as store
from tests.fakes import MemoryClip


class Slow:
    """A teacher that counts how often it is asked."""

    name, provenance, pixelwise, encoder = "slow", "made up", True, EmbeddedEncoder()

    def __init__(self, frames=(0, 2, 3, 4), **settings):
        self.frames, self.settings, self.asked = list(frames), settings, []

    def answer(self, frame):
        index = np.full((6, 7), frame - 1, np.int32)
        return (np.eye(9, 5, dtype=np.float32) + frame, index) if frame != 3 else None

    def compute(self, frames, progress):
        for done, frame in enumerate(reversed(frames)):
            progress(done / len(frames), "thinking")
            self.asked.append(frame)
            yield frame, self.answer(frame)


def test_the_second_asking_reads_what_the_first_one_wrote():
    first, second, other = Slow(a=1), Slow(a=1), Slow(a=2)
    for teacher in (first, second, other):
        kept = with_cached_targets(teacher)
        assert (kept.name, kept.frames, kept.pixelwise) == ("slow", [0, 2, 3, 4], True)
        for frame in range(6):
            answer, expected = kept.targets(frame), teacher.answer(frame) if frame in teacher.frames else None
            assert (answer is None) == (expected is None)
            if answer is not None:
                assert [part.dtype for part in answer] == [np.float32, np.int32]
                assert all(np.array_equal(a, b) for a, b in zip(answer, expected, strict=True))
    assert (first.asked, second.asked, other.asked) == ([4, 3, 2, 0], [], [4, 3, 2, 0])


def test_an_interrupted_asking_goes_on_where_it_stopped():
    def stop_halfway(fraction, message):
        if fraction >= 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        with_cached_targets(Slow(), stop_halfway)
    again = Slow()
    with_cached_targets(again)
    assert again.asked == [2, 0]


def test_a_teacher_that_costs_nothing_is_not_kept():
    teacher = LabelTeacher(MemoryClip(), EmbeddedEncoder())
    assert with_cached_targets(teacher) is teacher
    assert store.cache_use().entries == 0


def test_a_damaged_answer_is_one_sentence():
    kept = with_cached_targets(Slow())
    path = kept.folder / "000002.npz"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(DegenseError, match=r"000002\.npz is gone or damaged; clear the cache with degense cache --clear"):
        kept.targets(2)
    pickled = np.array([{"a": 1}], dtype=object)
    np.savez(path, vectors=pickled, index=pickled)
    with pytest.raises(DegenseError, match="damaged"):
        kept.targets(2)


@pytest.mark.parametrize(
    ("vectors", "index"),
    [
        (np.full((2, 3), np.nan), np.zeros((4, 5), int)),
        (np.ones((2, 3)), np.full((4, 5), 2)),
        (np.ones((2, 3)), np.full((4, 5), -2)),
        (np.ones((2, 3)), np.zeros((4, 5))),
        (np.ones(3), np.zeros((4, 5), int)),
        (np.ones((2, 3)), np.zeros(4, int)),
        (np.zeros((2, 3), "M8[s]"), np.zeros((4, 5), int)),
    ],
    ids=["not finite", "beyond the vectors", "below none", "fractions", "one vector", "no map", "dates"],
)
def test_targets_that_do_not_fit_each_other_are_damaged(vectors, index):
    kept = with_cached_targets(Slow())
    np.savez(kept.folder / "000002.npz", vectors=vectors, index=index)
    with pytest.raises(DegenseError, match=r"000002\.npz is gone or damaged"):
        kept.targets(2)


def test_an_array_that_announces_more_than_it_holds_takes_no_memory():
    """Numbers that a header announces are asked for by numpy at once; a header of brackets raises an error of Python's tokenizer."""
    kept = with_cached_targets(Slow())
    for header in (b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 9)}", b"(" * 200):
        with zipfile.ZipFile(kept.folder / "000002.npz", "w") as archive:
            for name in ("vectors.npy", "index.npy"):
                archive.writestr(name, b"\x93NUMPY\x01\0" + len(header).to_bytes(2, "little") + header + bytes(80))
        with pytest.raises(DegenseError, match=r"000002\.npz is gone or damaged"):
            kept.targets(2)


def test_what_was_not_read_for_longest_makes_room():
    old, recent = (with_cached_targets(Slow(a=a)).folder for a in (1, 2))
    long_ago = time.time() - 2 * store.IN_USE
    os.utime(old, (long_ago, long_ago))
    store.set_limit(1)
    assert not old.exists()
    assert recent.exists()  # a training may be reading it
    os.utime(recent, (long_ago, long_ago))
    new = with_cached_targets(Slow(a=3)).folder
    assert not recent.exists()
    assert new.exists()
    assert store.cache_use().limit == 1


def test_clearing_leaves_the_limit_and_nothing_else():
    with_cached_targets(Slow())
    store.set_limit(10 << 30)
    assert store.clear_cache().entries == 1
    use = store.cache_use()
    assert (use.entries, use.bytes, use.limit) == (0, 0, 10 << 30)
