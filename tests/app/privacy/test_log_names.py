"""The log holds what went wrong, and no name of what was opened."""

from __future__ import annotations

import logging

import pytest

from degense.app.shell import logs

OPENED = "Roentgen Anna/op 1950"


@pytest.fixture
def opened(tmp_path, monkeypatch):
    monkeypatch.setattr(logs, "_hidden", set())
    path = tmp_path / OPENED
    logs.hide_names(path)
    return path


def test_paths_and_names_are_signs(opened):
    lines = (
        f"{opened} cannot be written: disk full.",
        f"{opened.as_posix()}/frames/a.png is damaged",
        "op 1950 has no semantics; Roentgen Anna is a folder",
        f"starting {logs.sys.executable} -m degense.app train {opened} --out {opened.parent}/run",
        "elsewhere: /srv/Curie/clip.mp4 and D:\\Curie\\clip.mp4 are gone",
    )
    for line in lines:
        told = logs.nameless(line)
        assert not any(name in told for name in ("Anna", "Roentgen", "op 1950", "Curie")), told
        assert "<name " in told
    assert logs.nameless(lines[0]).endswith("cannot be written: disk full.")
    assert logs.nameless(str(opened)) == logs.nameless(str(opened))  # the same sign in all lines


def test_the_program_itself_keeps_its_name(opened):
    line = f'File "{logs.PROGRAM}/app/main.py", line 3; loss 0.1/0.2, a/b'
    assert logs.nameless(line) == line


def test_tracebacks_are_written_without_names(opened):
    try:
        raise FileNotFoundError(2, "No such file", str(opened / "labels"))
    except FileNotFoundError:
        record = logging.getLogger("x").makeRecord("x", 40, "f", 1, "failed in %s", (opened,), logs.sys.exc_info())
    told = logs.NamelessFormatter("%(message)s").format(record)
    assert "Traceback" in told
    assert "Anna" not in told
    assert "test_log_names.py" in told or "<name" in told
