"""Nothing is lost: processes are really killed, disks really full, files really damaged."""

from __future__ import annotations

import json
import os
import resource
import signal
import time
from pathlib import Path

import pytest

from degense.app.session import journal, session_file
from degense.app.session.session import Session
from degense.app.session.session_file import DamagedSession
from degense.app.session.state_folder import JOURNAL, folder_of, left_behind
from degense.engine.errors import DegenseError
from tests.app.painting import FakeScene, Strokes, opened, paint_and_kill


def test_kill_while_painting_loses_no_stroke(tmp_path):
    last = paint_and_kill(tmp_path)
    assert left_behind() == [tmp_path]
    session, strokes = opened(tmp_path)
    assert strokes.strokes == []  # until the user has decided
    with pytest.raises(DegenseError, match="restore it or discard"):
        session.save()
    session.recover()
    assert strokes.strokes[: last + 1] == list(range(last + 1))
    assert len(strokes.strokes) <= last + 2  # the stroke it was killed in may have arrived
    assert session.dirty
    strokes.add(-7)  # the journal goes on
    session.close()
    session, strokes = opened(tmp_path)
    session.recover()
    assert (strokes.strokes[-1], strokes.strokes.count(0)) == (-7, 1)
    session.save()
    assert left_behind() == []
    session.close()
    assert opened(tmp_path)[1].strokes[-1] == -7  # told once, by the file


def test_kill_while_saving_leaves_a_whole_session(tmp_path):
    """Saves of a megabyte in a tight loop; killed at five moments of them."""
    for number in range(5):
        folder = tmp_path / str(number)
        folder.mkdir()
        last = paint_and_kill(folder, save_every=2, weight=1 << 20, seconds=0.05 + 0.037 * number)
        session, strokes = opened(folder)
        session.recover()
        assert strokes.strokes[: last + 1] == list(range(last + 1))
        assert strokes.strokes == sorted(set(strokes.strokes))
        session.close()


def test_a_crash_between_saving_and_emptying_the_journal_applies_nothing_twice(tmp_path):
    session, strokes = opened(tmp_path)
    strokes.add(1)
    left = (folder_of(tmp_path) / JOURNAL).read_bytes()
    session.save()
    session.close()
    (folder_of(tmp_path) / JOURNAL).write_bytes(left)
    session, strokes = opened(tmp_path)
    assert (session.store.unsaved, strokes.strokes) == ([], [1])


@pytest.mark.parametrize("torn", [b'{"part":"strokes","rec', b"\x00\xff\n", b"[1]\n"])
def test_a_torn_journal_is_good_up_to_the_tear(tmp_path, torn):
    session, strokes = opened(tmp_path)
    strokes.add(5)
    session.close()
    with open(folder_of(tmp_path) / JOURNAL, "ab") as file:
        file.write(torn)
    session, strokes = opened(tmp_path)
    session.recover()
    strokes.add(6)
    session.close()
    session, strokes = opened(tmp_path)
    session.recover()
    assert strokes.strokes == [5, 6]


def test_a_full_disk_leaves_the_old_file_and_the_mark(tmp_path):
    """The limit on the size of files stands for the disk's end: a write beyond it fails as on a full disk."""
    session, strokes = opened(tmp_path)
    strokes.add(1)
    session.save()
    before = (tmp_path / session_file.NAME).read_bytes()
    troubles: list[str] = []
    session.store.problem_changed.connect(troubles.append)
    strokes.weight = 1 << 16
    old, limit = signal.signal(signal.SIGXFSZ, signal.SIG_IGN), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 10, limit[1]))
    try:
        for stroke in range(2, 60):  # the journal outgrows the disk too
            strokes.add(stroke)
        with pytest.raises(DegenseError, match="cannot be written"):
            session.save()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, old)
    assert (tmp_path / session_file.NAME).read_bytes() == before
    assert not list(tmp_path.glob(".session-*"))
    assert session.dirty
    assert len(troubles) == 2  # each said once
    assert "a crash would lose" in troubles[0]
    assert not session.store.journaled
    session.store.write_pending()  # there is room again: what the journal missed is made up for
    assert session.store.journaled
    assert [entry.record["stroke"] for entry in journal.entries(folder_of(tmp_path) / JOURNAL, session.store._saved.id)] == list(
        range(2, 60)
    )
    session.save()
    assert not session.dirty
    assert troubles[2:] == [""]
    session.close()
    assert opened(tmp_path)[1].strokes == list(range(1, 60))


@pytest.mark.parametrize(
    "damage",
    ["", "{]", '{"id": 3, "parts": []}', '{"id": "x", "parts": {"look": 5}}', '{"id": "x", "parts": {"strokes": {}}}', "\x00" * 99],
)
def test_a_damaged_session_never_opens_as_empty(tmp_path, damage):
    session, strokes = opened(tmp_path)
    strokes.add(1)
    session.save()
    strokes.add(2)
    session.save()  # the first is now a backup
    session.close()
    file = tmp_path / session_file.NAME
    file.write_text(damage)
    strokes = Strokes()
    session = Session()
    session.register("strokes", strokes)
    with pytest.raises(DamagedSession, match=r"session\.json is damaged .* open its backup") as caught:
        session.open_scene(FakeScene(tmp_path))
    assert session.scene is None
    session.save()  # there is nothing to save: the damaged file is left alone
    assert file.read_text() == damage
    session_file.restore(caught.value.backups[0], file)
    session.open_scene(FakeScene(tmp_path))
    assert strokes.strokes == [1]
    assert (tmp_path / "session.json.bad").read_text() == damage


def test_backups_are_spaced_and_few(tmp_path):
    path = tmp_path / session_file.NAME
    now = 1_700_000_000
    for save in range(40):
        session_file.write(path, session_file.SavedSession({"save": save}, session_file.new_id()))
        os.utime(path, (now + 100 * save,) * 2)
    kept = session_file.backups(tmp_path)
    numbers = [json.loads(file.read_text())["parts"]["save"] for file in kept]
    assert numbers == [36 - 3 * step for step in range(session_file.KEPT)]


def test_two_windows_do_not_write_over_each_other(tmp_path):
    first, strokes = opened(tmp_path)
    strokes.add(1)
    second, others = opened(tmp_path)
    assert second.store.elsewhere
    assert second.store.unsaved == []  # it is the other's, and alive
    others.add(9)
    for _ in range(2):  # also when the other has saved and is closed: what is there now is unknown to this one
        with pytest.raises(DegenseError, match="open in another window"):
            second.save()
        first.save()
        first.close()
    second.close()
    assert opened(tmp_path)[1].strokes == [1]


def test_small_states_are_written_once_a_tick_and_the_cursor_never(tmp_path):
    session, _ = opened(tmp_path)
    session.go_to(4)
    for step in range(20):
        session.view.set_threshold(step / 20)
    session.store.write_pending()
    assert len((folder_of(tmp_path) / JOURNAL).read_text().splitlines()) == 2
    session.close()
    again, _ = opened(tmp_path)
    again.recover()
    assert (again.view_state.threshold, again.frame) == (0.95, 0)


def test_what_is_painted_is_on_the_disk_a_tick_later(tmp_path, monkeypatch):
    """The window calls `write_pending` every second; a power cut after the next loses nothing of before."""
    synced: dict[str, bytes] = {}
    fsync = os.fsync

    def kept(handle: int) -> None:
        fsync(handle)
        path = Path(os.readlink(f"/proc/self/fd/{handle}"))
        synced[path.name] = path.read_bytes() if path.is_file() else b""

    session, strokes = opened(tmp_path)
    monkeypatch.setattr(os, "fsync", kept)
    for stroke in range(3):
        strokes.add(stroke)
        session.store.write_pending()
        deadline = time.monotonic() + 20
        while synced.get(JOURNAL) != (folder_of(tmp_path) / JOURNAL).read_bytes():
            assert time.monotonic() < deadline
            time.sleep(0.001)
    assert synced.keys() >= {JOURNAL, folder_of(tmp_path).name}
    session.close()


def test_a_disk_that_keeps_nothing_is_said(tmp_path, monkeypatch):
    def broken(handle: int) -> None:
        raise OSError(5, "Input/output error")

    session, strokes = opened(tmp_path)
    strokes.add(0)
    monkeypatch.setattr(os, "fsync", broken)
    deadline = time.monotonic() + 20
    while not session.store.problem:
        assert time.monotonic() < deadline
        strokes.add(1)
        session.store.write_pending()
    assert "a power cut would lose" in session.store.problem
    session.close()
