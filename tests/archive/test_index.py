"""The index file: made once, brought up to date, resumed, shared by two programs, and refused where it is not ours."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path, PurePosixPath

import pytest
from filelock import FileLock

from degense.app.cli.main import main
from degense.engine.archive.index_file import INDEX, open_index
from degense.engine.archive.indexing import LOCK, find_runs, update_index
from degense.engine.archive.search import search
from degense.engine.errors import DegenseError
from degense.engine.progress import finish
from tests.archive import made


def indexed(folder: Path) -> dict[str, str]:
    """The runs of an index with what is wrong with them."""
    with open_index(folder / INDEX) as index:
        return {str(run.path): run.error for run in index.runs()}


def test_only_what_is_new_or_changed_is_looked_through(indexed_scene, speechless, tmp_path, monkeypatch):
    archive = tmp_path / "archive"
    shutil.copytree(indexed_scene.parent, archive)
    assert finish(update_index(archive)).indexed == []
    shutil.copytree(archive / "one", archive / "later" / "two")
    shutil.copytree(speechless.run.path, archive / "mute")
    (archive / "broken").mkdir()
    (archive / "broken" / "run.json").write_text("{half")
    done = finish(update_index(archive))
    assert [str(path) for path in done.indexed] == ["later/two"]
    assert {str(path) for path, _ in done.broken} == {"broken", "mute"}
    assert indexed(archive)["one"] == ""
    assert "without semantics" in indexed(archive)["mute"]
    assert "broken/run.json cannot be read" in indexed(archive)["broken"]
    again = finish(update_index(archive))
    assert (again.indexed, again.broken) == ([], [])  # what is broken is tried again when it has changed
    os.utime(archive / "one" / "model.safetensors", ns=(1, 1))
    shutil.rmtree(archive / "mute")
    last = finish(update_index(archive))
    assert ([str(path) for path in last.indexed], last.forgotten) == (["one"], 1)
    assert sorted(indexed(archive)) == ["broken", "later/two", "one"]


def test_what_was_stopped_goes_on_with_the_next_run(indexed_scene, tmp_path):
    for name in ("a", "b"):
        shutil.copytree(indexed_scene.parent / "one", tmp_path / name)
    steps = update_index(tmp_path)
    while "run 2 of 2" not in next(steps)[1]:
        pass
    steps.close()
    assert indexed(tmp_path) == {"a": ""}
    assert [str(path) for path in finish(update_index(tmp_path)).indexed] == ["b"]


def test_a_killed_program_leaves_what_it_has_written(indexed_scene, tmp_path):
    for name in ("a", "b"):
        shutil.copytree(indexed_scene.parent / "one", tmp_path / name)
    code = (
        "import os, sys; from pathlib import Path; from degense.engine.archive.indexing import update_index\n"
        "for fraction, said in update_index(Path(sys.argv[1])):\n    if 'run 2 of 2' in said: os._exit(9)"
    )
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path)]).returncode == 9
    assert indexed(tmp_path) == {"a": ""}
    assert [str(path) for path in finish(update_index(tmp_path)).indexed] == ["b"]


def test_of_two_programs_one_indexes(indexed_scene, tmp_path, capsys):
    archive = tmp_path / "archive"
    shutil.copytree(indexed_scene.parent, archive)
    shutil.copytree(archive / "one", archive / "two")
    with FileLock(archive / LOCK):
        assert finish(update_index(archive)).busy
        assert main(["search", str(archive), "liver"]) == 0
    said = capsys.readouterr()
    assert "another program is indexing" in said.err
    assert "of 1 run" in said.out
    reader = open_index(archive / INDEX)
    with reader as opened:  # while another writes
        assert finish(update_index(archive)).indexed == [PurePosixPath("two")]
        assert len(search(opened, "liver").hits) == 2


def test_runs_are_found_below_but_links_are_not_followed(tmp_path):
    for name in ("a", "deep/er/b", ".hidden/c", "a/inside"):
        (tmp_path / "archive" / name).mkdir(parents=True)
        (tmp_path / "archive" / name / "run.json").write_text("{}")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "run.json").write_text("{}")
    (tmp_path / "archive" / "link").symlink_to(tmp_path / "elsewhere")
    assert [str(path) for path in find_runs(tmp_path / "archive")] == ["a", "deep/er/b"]
    with pytest.raises(DegenseError, match="is no folder"):
        find_runs(tmp_path / "archive" / "a" / "run.json")


def altered(*statements: str):
    def alter(path: Path) -> None:
        with closing(sqlite3.connect(path)) as database:
            database.executescript(";".join(statements))

    return alter


def facts(**values) -> str:
    known = {
        "frames": made.FRAMES,
        "size": [64, 48],
        "fps": 25.0,
        "unit": "mm",
        "things": {"classes": ["liver"], "kinds": [], "closed": True},
    }
    return json.dumps(known | values)


MANY = {"classes": ["liver"], "kinds": [[f"kind {number}", ["liver"]] for number in range(255)], "closed": True}
HOSTILE = {
    "of another program": lambda path: (path.unlink(), altered("CREATE TABLE places (url TEXT)")(path)),
    "no database": lambda path: path.write_bytes(b"MZ" * 4000),
    "empty": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:6000]),
    "of another version": altered("PRAGMA user_version = 99"),
    "of the layout before this": altered("PRAGMA user_version = 1"),
    "with a trigger": altered("CREATE TRIGGER t AFTER DELETE ON runs BEGIN DELETE FROM columns; END"),
    "with a view for a table": altered("DROP TABLE runs", "CREATE VIEW runs AS SELECT 1 AS id"),
    "in write-ahead mode": altered("PRAGMA journal_mode = WAL"),
    "tables whose names are no letters": lambda path: path.write_bytes(path.read_bytes().replace(b"E TABLE ru", b"E TAB\xccE ru")),
    "by other rules": altered("UPDATE rules SET text = '{}'"),
    "a path that leaves": altered("UPDATE runs SET path = '../../etc'"),
    "an absolute path": altered("UPDATE runs SET path = '/etc'"),
    "numbers that cannot be": altered(f"UPDATE runs SET facts = '{facts(frames=10**12)}'"),
    "no numbers": altered("UPDATE runs SET facts = '[]'"),
    "more things than have numbers": altered(f"UPDATE runs SET facts = '{facts(things=MANY)}'"),
    "a run without a number": altered("UPDATE runs SET id = -5"),
    "a run with too large a number": altered("UPDATE runs SET id = 1 << 60"),
    "deep": altered(f"UPDATE runs SET facts = '{'[' * 5000}'"),
    "columns too short": altered("UPDATE columns SET data = x'00'"),
    "columns of text": altered("UPDATE columns SET data = 'aaaa'"),
    "more objects than there are": altered(f"UPDATE columns SET data = x'{'ff' * 2 * made.FRAMES}' WHERE number & 15 = 0"),
    "bytes overwritten": lambda path: path.write_bytes(path.read_bytes()[:16_384] + b"\xff" * 100_000 + path.read_bytes()[116_384:]),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_file_that_is_not_ours_is_refused_and_left_alone(case, tmp_path, capsys):
    path = made.archive(tmp_path, a=made.observed(made.film(1)))
    HOSTILE[case](path)
    before = path.read_bytes()
    for command in (["--as-is"], []):
        assert main(["search", str(tmp_path), "liver touching fat", *command]) == 2 or case in KEPT_BY_AN_UPDATE
        said = capsys.readouterr().err
        assert case in KEPT_BY_AN_UPDATE or (said.startswith("degense: ") and said.count("\n") == 1), said
        if command:
            assert path.read_bytes() == before


#: The run named is not in the folder, so an update forgets it with its columns before they are read.
KEPT_BY_AN_UPDATE = ("columns too short", "columns of text", "more objects than there are")


def test_a_link_or_a_pipe_is_no_index(tmp_path):
    path = made.archive(tmp_path, a=made.observed(made.film(1)))
    other = tmp_path / "other"
    other.mkdir()
    (other / INDEX).symlink_to(path)
    with pytest.raises(DegenseError, match="no file of its own"):
        finish(update_index(other))
    (other / INDEX).unlink()
    os.mkfifo(other / INDEX)
    with pytest.raises(DegenseError, match="no file of its own"):
        finish(update_index(other))


def test_the_command_lists_writes_and_opens(indexed_scene, tmp_path, capsys):
    folder, said = indexed_scene.parent, tmp_path / "said.json"
    out = ["--json", str(said), "--thumbnails", str(tmp_path / "pictures")]
    assert main(["search", str(folder), "tool near liver", "liver inside tool or fat", *out]) == 0
    shown = capsys.readouterr().out
    near, inside = json.loads(said.read_text(encoding="utf-8"))["questions"]
    assert f"tool near liver: {len(near['moments'])} moment" in shown
    assert {"run", "first", "last", "peak", "area", "confidence", "displacement", "fps", "unit"} <= {*near["moments"][0]}
    assert len([*(tmp_path / "pictures" / "01-tool-near-liver").glob("*.jpg")]) == len(near["moments"])
    assert "not answered from the index (--open asks the run): one: " in shown
    assert [row["run"] for row in inside["unanswered"]] == ["one"]
    assert main(["search", str(folder), "liver inside tool or fat", "--open", "--as-is", "--json", str(said)]) == 0
    assert json.loads(said.read_text(encoding="utf-8"))["questions"][0]["unanswered"] == []
    assert main(["search", str(folder), "xylophone"]) == 2
    assert main(["search", str(tmp_path), "liver", "--as-is"]) == 2
    assert "has no index yet" in capsys.readouterr().err
