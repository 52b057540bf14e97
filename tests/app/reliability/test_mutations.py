"""How inputs are damaged and followed: what leads to new steps is damaged further, and what leads out of the input is found."""

from __future__ import annotations

import random
from contextlib import suppress
from pathlib import Path

import pytest

from degense.app.research.reliability import mutations, steps
from degense.app.research.reliability.damage.mutate import mutated
from degense.app.research.reliability.damage.plain import OUTSIDE
from degense.app.research.reliability.guarded import is_sentence
from degense.app.research.reliability.readers import readers
from degense.app.research.reliability.readers.reader import Reader
from degense.app.research.reliability.samples import data_sets
from degense.app.research.reliability.steps import steps_in, traced
from degense.engine.data.readers.detect import OPENERS, detect
from degense.engine.errors import DegenseError


def one_bit(data: bytes, name: str, rng: random.Random) -> bytes:
    """Other bytes, of which one bit is another."""
    spoilt = bytearray(data)
    spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
    return bytes(spoilt)


def zeros(folder: Path) -> Path:
    (folder / "a").write_bytes(bytes(4))
    return folder / "a"


def stairs(path: Path) -> None:
    """Crashes for four bytes that are not zero: by one bit at a time nothing else than going on from what came further leads there."""
    first, second, third, fourth = path.read_bytes()
    if not first:
        return
    if not second:
        return
    if not third:
        return
    if fourth:
        raise KeyError("the top of the stairs")


@pytest.fixture
def followed(monkeypatch):
    """The steps of this file are followed, as those of the program are."""
    monkeypatch.setattr(steps, "OURS", (__file__,))


def test_what_leads_to_new_steps_is_damaged_further(followed, monkeypatch, tmp_path):
    monkeypatch.setattr(mutations, "mutated", one_bit)
    found = mutations.tally(Reader("stairs", zeros, stairs), 100, tmp_path / "guided", seed=15)
    assert found.outcomes["CRASHED"] > 0
    assert "the top of the stairs" in found.defects[0]
    monkeypatch.setattr(mutations, "FURTHER", 0.0)
    blind = mutations.tally(Reader("stairs", zeros, stairs), 40, tmp_path / "blind", seed=15)
    assert blind.defects == []
    assert blind.steps < found.steps


def test_steps_are_those_of_the_lines_that_were_run(followed, tmp_path):
    def branch(where: bool) -> None:
        if where:
            return
        raise DegenseError("no.")

    taken = []
    for where in (True, True, False):
        with suppress(DegenseError):
            traced(lambda where=where: branch(where), tmp_path / "steps")
        taken.append(steps_in(tmp_path / "steps"))
    assert taken[0] == taken[1]
    assert taken[0] - taken[2]
    assert taken[2] - taken[0]
    assert steps_in(tmp_path / "none") == set()


@pytest.mark.parametrize(
    ("name", "left"), [(f"../../../{OUTSIDE}", True), (f"/{OUTSIDE}", True), (f"inner/{OUTSIDE}", False), ("a", False)]
)
def test_an_input_that_leads_out_of_its_folder_is_found(name, left, monkeypatch, tmp_path):
    """The file that is named is opened where it is, and its absence is a refusal: that it was tried is the defect."""

    def make(folder: Path) -> Path:
        (folder / "inner").mkdir()
        (folder / "inner" / "a").write_text("a")
        return folder / "inner" / "a"

    def follow(path: Path) -> None:
        try:
            (path.parent / path.read_text()).read_bytes()
        except OSError as error:
            raise DegenseError("Nothing is there.") from error

    monkeypatch.setattr(mutations, "mutated", lambda data, of, rng: name.encode())
    found = mutations.tally(Reader("follows", make, follow), 1, tmp_path / "scratch", seed=0)
    assert bool(found.defects) is left
    assert not left or "outside of the input" in found.defects[0]


def test_every_layout_of_clips_has_a_sample():
    names = {reader.name for reader in readers()}
    for layout in OPENERS:
        assert {f"clip {layout}", f"clip {layout}-text"} & names, layout


@pytest.mark.parametrize("layout", ["servct", "c3vd", "cholecseg8k", "endovis18", "stir", "surgt"])
def test_samples_are_of_the_layout_they_stand_for(layout, tmp_path):
    assert detect(getattr(data_sets, layout)(tmp_path / "clip")) == layout


def test_mutations_are_repeatable_and_differ():
    data = b'{"a": [1, 2, {"b": "c"}], "d": 0.5}'
    first, again = ([mutated(data, "x.json", rng) for _ in range(30)] for rng in (random.Random(3), random.Random(3)))
    assert first == again
    assert len(set(first)) > 20


def test_what_was_damaged_beyond_its_format_is_damaged_again():
    for deep in (b"[" * 100_000, b"{", b"", b"\xff"):
        for name in ("x.json", "x.npy", "x.safetensors", "x.yaml", "x.jsonl"):
            for seed in range(20):
                mutated(deep, name, random.Random(seed))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a.json is damaged; copy it again.", True),
        ("no CUDA GPU was found; train with --device cpu, or see degense doctor", True),
        ("", False),
        ("a.json", False),
        ("a.json is damaged;\ncopy it again.", False),
        (" a.json is damaged; copy it again.", False),
        ("a.json is damaged: \x1b[31m it is red.", False),
        ("a.json is damaged (KeyError: 2).", False),
        ("a.json is damaged ('NoneType' object is not iterable).", False),
        ("a.json is damaged ('str' object has no attribute 'get').", False),
        ("a.json is damaged: [Errno 2] No such file or directory.", False),
        ("a.json is damaged: " + "9" * 2000, False),
    ],
)
def test_what_counts_as_a_sentence(text, sentence):
    assert is_sentence(text) is sentence


def test_the_formats_of_the_campaign_have_readers():
    """PLY is not among them: none is read."""
    names = " ".join(reader.name for reader in readers())
    for kind in ("frames", "jpeg", "video", "npz", "checkpoint", "coco", "cvat", "yolo", "nifti", "nrrd", "plan", "session", "journal"):
        assert kind in names.split() or f"-{kind}" in names, kind
    for kind in ("run in napari", "points json", "points csv", "cover", "cached targets", "features of a teacher, torch", "check sums"):
        assert kind in names, kind
    assert "ply" not in names
