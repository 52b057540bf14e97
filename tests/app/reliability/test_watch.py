"""An input that leads out of its folder is found by what is done there: opened, listed, made, moved, removed, or a program started."""

from __future__ import annotations

import json
import os
import pickle
import sqlite3
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import pytest

from degense.app.research.reliability.damage.archives import PICKLES
from degense.app.research.reliability.guarded import READ, guarded
from degense.app.research.reliability.watch import watched


def became(read, tmp_path: Path):
    """What becomes of a reader of `inside`, beside which `outside` lies."""
    for name in ("inside", "outside"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a").write_text("1")
    return guarded(partial(watched, read, tmp_path / "inside" / "a", tmp_path / "inside", tmp_path / "own"), 20.0, 512)


LEAVING = {
    "opened": lambda place: (place / "a").read_text(),
    "opened where it is not": lambda place: os.open(place / "none", os.O_RDONLY),
    "written": lambda place: (place / "b").write_text("1"),
    "listed": os.listdir,
    "searched": lambda place: list(place.glob("*")),
    "made": lambda place: (place / "made").mkdir(),
    "removed": lambda place: (place / "a").unlink(),
    "moved": lambda place: (place / "a").rename(place / "c"),
    "linked": lambda place: (place / "link").symlink_to("a"),
    "a database": lambda place: sqlite3.connect(place / "a.sqlite"),
}


@pytest.mark.parametrize("what", LEAVING)
def test_a_reader_that_leaves_the_input_is_found(what, tmp_path):
    fate = became(lambda path: LEAVING[what](path.parents[1] / "outside"), tmp_path)
    assert fate.outcome == "CRASHED"
    assert "lies outside of the input" in fate.words
    assert str(tmp_path / "outside") in fate.words


@pytest.mark.parametrize("what", [what for what in LEAVING if what != "opened where it is not"])
def test_the_same_within_it_is_not(what, tmp_path):
    assert became(lambda path: LEAVING[what](path.parent), tmp_path).outcome == READ


def test_a_link_out_of_the_input_leads_out_of_it(tmp_path):
    def read(path: Path) -> None:
        (path.parent / "link" / "a").read_text()

    (tmp_path / "outside.d").mkdir()
    (tmp_path / "outside.d" / "a").write_text("1")

    def linked(path: Path) -> None:
        os.symlink(path.parents[1] / "outside.d", path.parent / "link")
        read(path)

    assert "outside.d" in became(linked, tmp_path).words


@pytest.mark.parametrize(
    "start", [lambda path: subprocess.run([sys.executable, "-c", ""]), lambda path: os.system("true")], ids=["subprocess", "system"]
)
def test_a_program_that_is_started_is_found(start, tmp_path):
    assert "was called" in became(start, tmp_path).words


@pytest.mark.parametrize(
    "use",
    [lambda path: tempfile.TemporaryFile().close(), lambda path: json.loads(Path(json.__file__).read_text() and "1")],
    ids=["own", "library"],
)
def test_own_places_and_libraries_are_not_outside(use, tmp_path):
    assert became(use, tmp_path).outcome == READ


def test_a_hostile_pickle_is_found_where_it_is_run(tmp_path):
    """Of those that the campaign puts into what torch saved; `pickle` runs it, which the program never does."""
    assert "os.mkdir" in became(lambda path: pickle.loads(PICKLES[0]), tmp_path).words
