"""The annotations folder: what was saved is read again, and nothing that is damaged opens as if it were empty."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from degense.engine import files
from degense.engine.annotation import folder as folder_module
from degense.engine.annotation.annotations import Annotations
from degense.engine.annotation.edits import Proposal, named_classes, pack
from degense.engine.annotation.folder import INDEX, load, save
from degense.engine.annotation.painting import brush
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError, RunError

SHAPE = (40, 50)


def nothing(frame: int) -> None:
    return None


@pytest.fixture
def annotations() -> Annotations:
    made = Annotations(named_classes(("liver", "grasper")), SHAPE, 6)
    made.paint(1, "a", brush((10, 10), (30, 20), 5, SHAPE), 1)
    made.propose({2: Proposal(pack(np.ones(SHAPE, np.uint8)), SHAPE, 0.5)})
    made.set_status(3, "flagged")
    return made


def test_a_round_trip(annotations, tmp_path):
    save(annotations, tmp_path)
    again = load(tmp_path, SHAPE, 6, nothing)
    assert again.classes == annotations.classes
    for frame in range(6):
        assert np.array_equal(again.labels(frame), annotations.labels(frame))
        assert np.array_equal(again.shown(frame), annotations.shown(frame))
        one, other = again.record(frame), annotations.record(frame)
        assert (one.by_hand, one.status, one.proposal) == (other.by_hand, other.status, other.proposal)
    before = {path.name for path in tmp_path.iterdir()}
    save(again, tmp_path)  # nothing was decoded, nothing is written anew
    assert {path.name for path in tmp_path.iterdir()} == before
    assert load(tmp_path / "none", SHAPE, 6, nothing) is None


def test_pictures_are_indexed_and_old_ones_go(annotations, tmp_path):
    save(annotations, tmp_path)
    [old] = tmp_path.glob("000001-*.png")
    shown = cv2.imread(str(old))[..., ::-1]
    assert tuple(shown[10, 10]) == annotations.classes[1].colour
    annotations.paint(1, "b", brush((40, 30), (40, 30), 3, SHAPE), 0)
    save(annotations, tmp_path)
    [new] = tmp_path.glob("000001-*.png")
    assert new != old


@pytest.mark.parametrize("at", range(4))
def test_an_interrupted_save_leaves_the_old_state(annotations, tmp_path, monkeypatch, at):
    save(annotations, tmp_path)
    wanted = load(tmp_path, SHAPE, 6, nothing).labels(1).copy()
    for frame in (0, 1, 4):
        annotations.paint(frame, "b", brush((20, 20), (20, 20), 9, SHAPE), 0)
    count = 0
    replace = files.os.replace

    def full_disk(source, target):
        nonlocal count
        count += 1
        if count > at:
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", full_disk)
    with pytest.raises(DegenseError, match="No space left"):
        save(annotations, tmp_path)
    monkeypatch.undo()
    assert np.array_equal(load(tmp_path, SHAPE, 6, nothing).labels(1), wanted)
    save(annotations, tmp_path)
    assert (load(tmp_path, SHAPE, 6, nothing).labels(1)[20, 15:25] == 0).all()


def change(path, **values):
    data = json.loads(path.read_text())
    data.update(values)
    path.write_text(json.dumps(data))


@pytest.mark.parametrize(
    "damage",
    [
        lambda index: index.write_text("{"),
        lambda index: index.write_text("[]"),
        lambda index: index.write_text("[" * 100_000),
        lambda index: change(index, format=2),
        lambda index: change(index, size=[50, 41]),
        lambda index: change(index, classes=[{"name": "", "colour": [0, 0, 0]}]),
        lambda index: change(index, classes=[{"name": "liver", "colour": "red"}]),
        lambda index: change(index, frames={"7": {"labels": None, "by_hand": False, "status": "open", "carried": None}}),
        lambda index: change(index, frames={"1": {"labels": "../secret.png", "by_hand": False, "status": "open", "carried": None}}),
        lambda index: change(index, frames={"1": {"labels": None, "by_hand": False, "status": "perhaps", "carried": None}}),
        lambda index: [path.unlink() for path in index.parent.glob("000001-*.png")],
        lambda index: [path.write_bytes(b"") for path in index.parent.glob("000002-*.png")],
    ],
)
def test_a_damaged_folder_does_not_open(annotations, tmp_path, damage):
    save(annotations, tmp_path)
    damage(tmp_path / INDEX)
    with pytest.raises(RunError):
        load(tmp_path, SHAPE, 6, nothing)


def test_a_damaged_map_is_said_when_it_is_looked_at(annotations, tmp_path):
    save(annotations, tmp_path)
    [path] = tmp_path.glob("000001-*.png")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    again = load(tmp_path, SHAPE, 6, nothing)
    with pytest.raises(RunError, match="damaged"):
        again.labels(1)
    save(again, tmp_path)  # and it is not written over
    assert path.read_bytes() == data


def test_a_label_that_no_class_names_is_refused(annotations, tmp_path):
    save(annotations, tmp_path)
    change(tmp_path / INDEX, classes=[{"name": "liver", "colour": [0, 0, 0]}])
    with pytest.raises(RunError, match="does not name"):
        load(tmp_path, SHAPE, 6, nothing).labels(2)


def test_large_files_are_not_read(annotations, tmp_path, monkeypatch):
    save(annotations, tmp_path)
    monkeypatch.setattr(folder_module, "LARGEST", 10)
    with pytest.raises(RunError, match="larger"):
        load(tmp_path, SHAPE, 6, nothing)
    assert UNLABELLED == 255
