"""Programs that are killed in the suite: a few cases of each, and that what is lost is found."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import pytest

from degense.app.research.reliability import kills
from degense.app.research.reliability.guarded import READ, guarded
from degense.app.research.reliability.kills import system_calls
from degense.app.research.reliability.kills.filesystem_log import lay_out, record
from degense.app.research.reliability.kills.program import Program
from degense.app.research.reliability.tally import NOTHING
from degense.engine.archive.index_file import INDEX
from degense.engine.archive.indexing import update_index
from degense.engine.files import write_text
from degense.engine.progress import finish
from degense.engine.research.bench.child import call_in_child
from tests.app.reliability import cases

#: Needs the recorder of system calls.
followed = pytest.mark.skipif(bool(system_calls.missing()), reason="needs strace")


def test_what_is_synced_survives_a_power_cut_and_nothing_else(tmp_path):
    """`write_text` survives; a file that is written but not synced is not there, and one whose name alone was kept is empty."""
    out, log, target = tmp_path / "out", tmp_path / "log", tmp_path / "target"
    out.mkdir()
    inode = out.stat().st_ino

    def work() -> None:
        record(out, log)
        write_text(out / "inner" / "a", "first")
        (out / "careless").write_text("x")
        write_text(out / "inner" / "a", "second")
        (out / "inner" / "late").write_text("y")
        write_text(out / "b", "third")

    assert guarded(work, 20.0, 512).sound
    lay_out(log, time.monotonic(), inode, target)
    assert {str(path.relative_to(target)): path.read_text() for path in target.rglob("*") if path.is_file()} == {
        "inner/a": "second",
        "careless": "",
        "b": "third",
    }
    shutil.rmtree(target)
    lay_out(log, 0.0, inode, target)
    assert list(target.iterdir()) == []


@pytest.mark.parametrize("how", ["SIGKILL", "power cut"])
def test_painting_survives_kills_and_power_cuts(how, tmp_path):
    tally = call_in_child(cases.killed, "annotate", how, 3, tmp_path / "scratch", 5.0)
    assert tally.outcomes == {READ: 3}, tally.defects


@pytest.mark.parametrize("how", ["SIGKILL", "power cut"])
def test_exports_are_whole_under_their_final_names(how, tmp_path):
    tally = call_in_child(cases.killed, "export", how, 2, tmp_path / "scratch", 5.0)
    assert tally.outcomes.total() == 2
    assert set(tally.outcomes) <= {READ, NOTHING}, tally.defects


def test_a_program_that_writes_carelessly_is_found(tmp_path):
    """It writes under the final name, and syncs nothing but the folder."""

    def work(folder: Path) -> None:
        handle = os.open(folder / "out", os.O_RDONLY)
        for number in range(40):
            (folder / "out" / f"{number}.json").write_text("{}")
            os.fsync(handle)
            time.sleep(0.02)

    def check(folder: Path, killed: object) -> None:
        for path in (folder / "out").iterdir():
            json.loads(path.read_text())

    program = Program("careless", lambda folder: None, work, check, lambda folder: True)
    tally = kills.tally(program, "power cut", 4, tmp_path / "scratch", seed=0, longest=1.0)
    assert set(tally.outcomes) == {"CRASHED"}


@pytest.mark.parametrize(("name", "how", "longest"), [("train", "SIGKILL", 4.0), ("batch", "SIGTERM", 4.0), ("index", "SIGKILL", 4.0)])
def test_what_is_killed_is_gone_on_with_to_the_same_end(name, how, longest, tmp_path):
    tally = call_in_child(cases.killed, name, how, 1, tmp_path / "scratch", longest)
    assert tally.outcomes.total() == 1
    assert set(tally.outcomes) <= {READ, NOTHING}, tally.defects


@followed
def test_an_index_survives_power_cuts(tmp_path):
    tally = call_in_child(cases.killed, "index", "power cut", 8, tmp_path / "scratch", 4.0)
    assert tally.outcomes[READ]
    assert set(tally.outcomes) <= {READ, NOTHING}, tally.defects


def test_an_index_whose_writer_was_cut_off_is_brought_up_to_date(tmp_path):
    """The copy is of a moment in a transaction of which the file has a part: SQLite takes it back from the journal."""
    for name in ("written", "cut"):
        (tmp_path / name).mkdir()
    finish(update_index(tmp_path / "written"))
    with closing(sqlite3.connect(tmp_path / "written" / INDEX, isolation_level=None)) as index:
        index.execute("PRAGMA cache_size = 1")
        index.execute("BEGIN IMMEDIATE")
        index.executemany("INSERT INTO columns VALUES (?, ?)", [(number, bytes(40_000)) for number in range(50)])
        for path in (tmp_path / "written").glob(f"{INDEX}*"):
            shutil.copyfile(path, tmp_path / "cut" / path.name)
        index.rollback()
    assert (tmp_path / "cut" / f"{INDEX}-journal").stat().st_size > 0
    finish(update_index(tmp_path / "cut"))
    with closing(sqlite3.connect(tmp_path / "cut" / INDEX)) as index:
        assert index.execute("SELECT count(*) FROM columns").fetchone() == (0,)


@followed
@pytest.mark.parametrize(("synchronous", "outcomes"), [("FULL", {READ}), ("OFF", {READ, "CRASHED"})])
def test_a_database_that_is_not_synced_is_found(synchronous, outcomes, tmp_path):
    """Both rewrite many pages in each transaction, and differ in nothing but the syncs of SQLite."""

    def prepare(folder: Path) -> None:
        (folder / "out").mkdir()
        with closing(sqlite3.connect(folder / "out" / "a.sqlite")) as database:
            database.execute("CREATE TABLE pairs (left INTEGER, right INTEGER, filling BLOB)")
            database.executemany("INSERT INTO pairs VALUES (0, 0, ?)", [(bytes(3000),)] * 30)
            database.commit()

    def work(folder: Path) -> None:
        with closing(sqlite3.connect(folder / "out" / "a.sqlite")) as database:
            database.execute(f"PRAGMA synchronous = {synchronous}")
            for number in range(20):
                database.execute("UPDATE pairs SET left = ?1, right = ?1, filling = randomblob(3000)", (number,))
                database.commit()

    def check(folder: Path, killed: object) -> None:
        with closing(sqlite3.connect(folder / "out" / "a.sqlite")) as database:
            assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
            assert database.execute("SELECT count(DISTINCT left), count(*) FROM pairs").fetchall() == [(1, 30)]

    program = Program("database", prepare, work, check, lambda folder: True, by_system_calls=True)
    tally = kills.tally(program, "power cut", 12, tmp_path / "scratch", seed=0, longest=10.0)
    assert set(tally.outcomes) == outcomes, tally.defects


def test_without_strace_the_table_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    row = kills.tally(cases.named("index"), "power cut", 3, tmp_path / "scratch", seed=0).row()
    assert (row["what"], row["cases"], row["words"]) == ("index, power cut", 0, system_calls.MISSING)


def test_half_an_export_is_found_in_every_format(tmp_path):
    for name, (whole, half) in call_in_child(cases.halved, tmp_path).items():
        assert whole.outcome == READ, f"{name}: {whole.words}"
        assert half.outcome != READ, name


def test_what_had_not_begun_is_not_read(tmp_path):
    program = Program("idle", lambda folder: None, lambda folder: None, lambda folder, killed: None, lambda folder: False)
    row = kills.tally(program, "SIGKILL", 2, tmp_path / "scratch", seed=0, longest=0.2).row()
    assert (row["cases"], row["read"], row["nothing"], row["defects"]) == (2, 0, 2, 0)
