"""Editing label maps: undo gives back every bit, in bytes rather than frames; proposals are accepted or rejected one by one."""

from __future__ import annotations

import json

import numpy as np
import pytest

from degense.engine.annotation.annotations import Annotations
from degense.engine.annotation.edits import LabelClass, Piece, Proposal, check_classes, named_classes, pack, unpack
from degense.engine.annotation.painting import brush, region_of
from degense.engine.annotation.statistics import ClassCount, class_counts, pixel_counts
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError

SHAPE = (512, 640)


def original(frame: int) -> np.ndarray | None:
    if frame != 0:
        return None
    labels = np.zeros(SHAPE, np.uint8)
    labels[100:200] = 1
    return labels


@pytest.fixture
def annotations() -> Annotations:
    return Annotations(named_classes(("liver", "gallbladder", "grasper")), SHAPE, 5, original)


def carried(value: int, confidence: float = 0.9) -> Proposal:
    return Proposal(pack(np.full(SHAPE, value, np.uint8)), SHAPE, confidence)


def state(annotations: Annotations) -> list:
    return [(annotations.record(i), annotations.labels(i).tobytes()) for i in range(annotations.count)]


def test_edits_are_undone_and_made_again_to_the_bit(annotations):
    random = np.random.default_rng(0)
    states, edits = [state(annotations)], []
    for step in range(12):
        start, end = random.uniform(0, 600, (2, 2))
        frame, value = int(random.integers(3)), int(random.choice([0, 1, 2, UNLABELLED]))
        edits.append(annotations.paint(frame, f"stroke {step}", brush(tuple(start), tuple(end), 9, SHAPE), value))
        states.append(state(annotations))
    for turn in range(2):
        for step in reversed(range(12)):
            if edits[step] is not None:
                annotations.restore(edits[step].before)
            assert state(annotations) == states[step]
        for step in range(12) if turn == 0 else ():
            if edits[step] is not None:
                annotations.restore(edits[step].after)
            assert state(annotations) == states[step + 1]


def test_a_dab_costs_bytes(annotations):
    edit = annotations.paint(1, "dab", brush((50, 50), (60, 55), 6, SHAPE), 2)
    assert edit.size < 1000
    assert edit.after[0].height < 25


def test_a_class_can_be_locked(annotations):
    edit = annotations.paint(0, "dab", region_of(np.ones((150, 10), bool), 60, 60), 2, inside=1)
    labels = annotations.labels(0)
    assert (labels[100:200, 60:70] == 2).all()
    assert (labels == 2).sum() == 100 * 10
    assert annotations.paint(0, "nothing", region_of(np.ones((5, 5), bool)), 0) is None
    assert original(0)[100, 60] == 1
    assert annotations.original(0)[100, 60] == 1
    annotations.restore(edit.before)
    assert np.array_equal(annotations.labels(0), original(0))
    assert annotations.record(0).status == "open"


def test_proposals_wait_and_are_accepted_or_rejected(annotations):
    annotations.paint(2, "dab", brush((5, 5), (5, 5), 3, SHAPE), 1)
    propose = annotations.propose({1: carried(1), 2: carried(0), 3: carried(2, 0.4)})
    assert annotations.waiting() == [1, 3]  # a hand has worked on 2
    assert annotations.review_queue() == [3]
    assert (annotations.shown(3) == 2).all()
    assert (annotations.labels(3) == UNLABELLED).all()
    accept = annotations.accept([1])
    assert annotations.record(1).status == "done"
    assert (annotations.labels(1) == 1).all()
    assert annotations.sources() == [2]  # accepted maps are not carried on as if by hand
    assert annotations.reject([3]).name == "Reject frame 3"
    assert annotations.waiting() == []
    assert annotations.accept([3]) is None
    annotations.restore(accept.before)
    assert annotations.waiting() == [1]
    annotations.restore(propose.before)
    assert annotations.waiting() == []
    assert annotations.record(2).by_hand


def test_painting_on_a_proposal_accepts_it(annotations):
    annotations.propose({1: carried(1)})
    edit = annotations.paint(1, "dab", brush((5, 5), (5, 5), 3, SHAPE), 2)
    assert annotations.record(1).proposal is None
    assert annotations.record(1).by_hand
    assert set(np.unique(annotations.labels(1))) == {1, 2}
    annotations.restore(edit.before)
    assert annotations.waiting() == [1]
    assert (annotations.labels(1) == UNLABELLED).all()
    annotations.restore(edit.after)
    assert set(np.unique(annotations.labels(1))) == {1, 2}


def test_flags_are_found_in_a_round(annotations):
    for frame in (1, 3):
        annotations.set_status(frame, "flagged")
    assert [annotations.next_in_queue(frame) for frame in (0, 1, 3)] == [1, 3, 1]
    annotations.set_status(1, "done")
    annotations.set_status(3, "open")
    assert annotations.next_in_queue(0) is None


def test_pieces_survive_json(annotations):
    annotations.propose({1: carried(1)})
    edit = annotations.paint(1, "dab", brush((5, 5), (5, 5), 3, SHAPE), 2)
    again = [Piece.from_json(json.loads(json.dumps(piece.to_json()))) for piece in (*edit.before, *edit.after)]
    assert tuple(again) == (*edit.before, *edit.after)


@pytest.mark.parametrize(
    "change",
    [
        {"frame": 9},
        {"box": [0, 0, 9999, 10]},
        {"box": [-1, 0, 4, 4]},
        {"labels": "a"},
        {"labels": 3},
        {"status": "?"},
        {"box": [0, 0, 2, 2]},
    ],
)
def test_pieces_from_elsewhere_are_checked(annotations, change):
    edit = annotations.paint(1, "dab", brush((5, 5), (5, 5), 3, SHAPE), 2)
    with pytest.raises((ValueError, KeyError, TypeError)):
        annotations.restore((Piece.from_json({**edit.after[0].to_json(), **change}),))


def test_packed_maps_are_checked_before_memory_is_taken():
    import zlib

    with pytest.raises(ValueError, match="not a packed"):
        unpack(b"nonsense", (4, 4))
    bomb = zlib.compress(bytes(50_000_000), 9)
    with pytest.raises(ValueError, match="17 bytes or more"):
        unpack(bomb, (4, 4))
    with pytest.raises(ValueError, match="of 4 bytes"):
        unpack(zlib.compress(bytes(4)), (4, 4))


def test_classes_are_checked():
    with pytest.raises(DegenseError, match="already"):
        check_classes([LabelClass("Liver", (0, 0, 0)), LabelClass("liver", (0, 0, 0))])
    with pytest.raises(DegenseError, match="at most 255"):
        check_classes(named_classes(str(i) for i in range(256)))
    with pytest.raises(DegenseError, match="name of 1"):
        check_classes(named_classes((" ",)))


def test_the_most_doubtful_frame_comes_first(annotations):
    for frame, confidence, unknown in ((0, 0.6, 0.0), (1, 0.9, 0.0), (2, 0.3, 0.0), (3, 0.95, 0.2)):
        annotations.propose({frame: Proposal(carried(1).packed, SHAPE, confidence, unknown)}, replacing=True)
    assert annotations.review_queue() == [2, 0, 3]  # 1 is sure
    annotations.set_status(1, "flagged")
    assert annotations.review_queue() == [1, 2, 0, 3]
    assert [annotations.next_in_queue(frame, 1) for frame in (1, 3)] == [2, 1]
    assert [annotations.next_in_queue(frame, -1) for frame in (1, 2)] == [3, 1]


def test_two_objects_of_one_class_are_kept_in_the_folder(annotations, tmp_path):
    from degense.engine.annotation.folder import load, save

    annotations.classes = (LabelClass("grasper", (1, 2, 3)), LabelClass("liver", (4, 5, 6)), LabelClass("grasper", (7, 8, 9), 2))
    annotations.paint(1, "dab", brush((5, 5), (5, 5), 3, SHAPE), 2)
    save(annotations, tmp_path)
    again = load(tmp_path, SHAPE, annotations.count, lambda frame: None)
    assert again.classes == annotations.classes
    assert np.array_equal(again.labels(1), annotations.labels(1))


def test_class_counts():
    maps = {0: np.full(SHAPE, 1, np.uint8), 4: np.full(SHAPE, UNLABELLED, np.uint8)}
    maps[4][:2] = 0
    size = SHAPE[0] * SHAPE[1]
    found = class_counts({frame: pixel_counts(labels) for frame, labels in maps.items()}, 3)
    some = 2 * SHAPE[1]
    assert found == [ClassCount(1, some, some / (size + some)), ClassCount(1, size, size / (size + some)), ClassCount(0, 0, 0.0)]
    assert class_counts({}, 1) == [ClassCount(0, 0, 0.0)]
