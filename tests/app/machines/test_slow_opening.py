"""A drive that is slow to give what is opened: the window asks it nothing itself, and goes on, whatever is done meanwhile."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from PySide6.QtWidgets import QMessageBox

from degense.app.research.reliability import stalls
from degense.app.session import session_file
from degense.app.session.session import Session
from degense.app.session.session_file import SavedSession
from degense.app.session.state_folder import left_behind
from degense.engine.annotation.folder import StoredMap
from degense.engine.annotation.painting import PixelRegion
from degense.engine.errors import Cancelled
from degense.engine.progress import check_reading
from tests.app import installed as on
from tests.app.painting import FakeScene
from tests.app.painting import opened as opened_session

#: A pixel that is painted in the first class, of which it is not in the clip.
DOT = PixelRegion(10, 20, np.ones((1, 1), bool))


@pytest.fixture
def asked(run, monkeypatch) -> Iterator[list[tuple[str, str]]]:
    """Each name that is asked of the drive on which clip and run lie, and the thread that waits for the answer."""
    seen: list[tuple[str, str]] = []
    drive = f"{run.parent}{os.sep}"

    def stand_still(path) -> None:
        if str(path).startswith(drive):
            seen.append((threading.current_thread().name, Path(str(path)).name))

    monkeypatch.setattr(os, "fsync", os.fsync)
    monkeypatch.setattr(stalls, "_stand_still", stand_still)
    stalls.stall(run.parent, 1.0)
    yield seen
    stalls.stall(run.parent, 0)


class Gate:
    """Where the worker waits before it reads the session of a folder: one short call after the other, until it is let through."""

    def __init__(self, folder: Path, read: Callable[[Path], SavedSession]) -> None:
        self.folder, self._read, self.reached, self.open, self.given_up = folder, read, threading.Event(), threading.Event(), False

    def __call__(self, path: Path) -> SavedSession:
        calls = 0
        while path.parent == self.folder and threading.current_thread().name == "worker" and not self.open.wait(0.005):
            self.reached.set()
            calls += 1
            assert calls < 4000, "nobody lets it through, and nobody stops it"
            try:
                check_reading()
            except Cancelled:
                self.given_up = True
                raise
        return self._read(path)


@pytest.fixture
def gate(qtbot, opened, other, monkeypatch) -> Iterator[Gate]:
    """A run is open, and the session of another is just being read."""
    gate = Gate(other, session_file.read)
    monkeypatch.setattr(session_file, "read", gate)
    on.documents(opened).open_path(other)
    qtbot.waitUntil(gate.reached.is_set)
    yield gate
    gate.open.set()


@pytest.fixture
def other(trained) -> Iterator[Path]:
    """A second run beside the clip."""
    copy = shutil.copytree(trained, trained.with_name("other"))
    yield copy
    shutil.rmtree(copy)


def is_free(folder: Path) -> bool:
    """Whether another window could change it."""
    session = Session()
    session.open_scene(FakeScene(folder))
    free = not session.store.elsewhere
    session.close()
    return free


def saved_prompts(folder: Path) -> str:
    return str(session_file.read(folder / session_file.NAME).states["look"])


@pytest.mark.parametrize("kind", ["run", "clip"])
def test_what_is_opened_is_read_by_the_worker_alone(window, run, tiny_clip, tmp_path, idle, asked, kind):
    path = run if kind == "run" else shutil.copytree(tiny_clip, run.parent / "painted")
    on.documents(window).open_path(path)
    idle()
    assert on.annotations(window).paint("Brush", DOT)
    window.registry.run("file.save")
    window.registry.run("file.close")
    asked.clear()
    on.documents(window).open_path(path)
    idle()
    assert {name for _, name in asked} >= {"session.lock", "session.json", "annotations.json"}
    assert {thread for thread, _ in asked} == {"worker"}
    assert on.annotations(window).labels(0)[10, 20] == 0
    if kind == "clip":
        window.registry.run("file.close")
        shutil.rmtree(path)


def test_a_saved_label_map_is_read_by_the_worker_before_it_is_shown(qtbot, window, run, idle, asked, monkeypatch):
    on.documents(window).open_path(run)
    idle()
    for frame in (2, 3):
        window.session.go_to(frame)
        on.annotations(window).paint("Brush", DOT)
    window.registry.run("file.save")
    on.documents(window).close()
    on.documents(window).open_path(run)
    idle()
    asked.clear()
    window.registry.run("annotate.mode")
    idle()
    given, read = threading.Event(), StoredMap._read
    monkeypatch.setattr(StoredMap, "_read", lambda self: (given.wait(60), read(self))[1])
    window.session.go_to(2)
    at = on.viewer(window).panel.zoom.to_widget(QPointF(40, 40)).toPoint()
    qtbot.mouseClick(on.viewer(window).panel, Qt.MouseButton.LeftButton, pos=at)  # which would paint what nobody sees
    assert "are being read" in window.statusBar().currentMessage()
    given.set()
    idle()
    assert on.annotations(window).labels(2)[10, 20] == 0
    assert {name[:7] for _, name in asked} >= {"000003-", "000002-"}
    assert {thread for thread, _ in asked} == {"worker"}
    qtbot.mouseClick(on.viewer(window).panel, Qt.MouseButton.LeftButton, pos=at)
    assert on.annotations(window).labels(2)[40, 40] == 0


def test_opening_is_seen_and_can_be_stopped(qtbot, opened, run, other, gate, idle):
    assert opened.status.busy_text.text() == "Opening other"
    assert opened.status.busy_bar.isVisible()
    qtbot.mouseClick(opened.status.stop, Qt.MouseButton.LeftButton)
    assert not opened.status.stop.isVisible()
    assert not opened.status.busy_bar.isVisible()
    opened.session.go_to(3)
    idle()  # the worker has given up what it read: it draws
    assert on.viewer(opened).view.frame == 3
    assert opened.session.scene.run.path == run
    assert is_free(other)
    assert not is_free(run)


def test_what_is_opened_last_is_shown(opened, run, other, gate, idle):
    on.documents(opened).open_demo()
    idle()
    assert opened.session.scene.run.path not in (run, other)
    assert is_free(other)
    assert is_free(run)


def test_what_is_done_until_the_next_is_there_is_saved(opened, run, other, gate, idle):
    opened.session.view.add_prompt("liver")
    assert on.annotations(opened).paint("Brush", DOT)
    gate.open.set()
    idle()
    assert opened.session.scene.run.path == other
    assert opened.session.view_state.prompts == ()
    assert "liver" in saved_prompts(run)
    assert left_behind() == []


def test_what_is_done_in_a_run_that_is_opened_again_stays(qtbot, opened, run, gate, idle):
    gate.folder, before = run, opened.session.scene
    gate.reached.clear()
    on.documents(opened).open_path(run)
    qtbot.waitUntil(gate.reached.is_set)
    opened.session.view.add_prompt("liver")
    assert on.annotations(opened).paint("Brush", DOT)
    gate.open.set()
    idle()
    assert opened.session.scene is not before
    assert [prompt.text for prompt in opened.session.view_state.prompts] == ["liver"]
    assert on.annotations(opened).labels(0)[10, 20] == 0
    assert opened.findChild(QMessageBox, "recovery") is None
    assert not opened.session.store.problem
    assert not is_free(run)  # it was held all the time, and is
    opened.session.view.add_prompt("grasper")
    opened.registry.run("file.save")
    assert "grasper" in saved_prompts(run)


def test_the_journal_of_what_is_open_is_left_alone_by_who_reads_it_again(tmp_path, monkeypatch):
    session, strokes = opened_session(tmp_path)
    strokes.add(1)
    with monkeypatch.context() as before_a_save:
        before_a_save.setattr(session_file, "read", lambda path: SavedSession({}, "of the file before"))
        session.reader()(session.scene, None, True)
    strokes.add(2)
    session.close()
    session, strokes = opened_session(tmp_path)
    session.recover()
    assert strokes.strokes == [1, 2]


def test_a_window_that_closes_waits_for_one_call_at_most(opened, run, other, gate):
    opened.session.view.add_prompt("liver")
    opened.close()
    assert not opened.isVisible()
    assert gate.given_up
    assert "liver" in saved_prompts(run)
    assert is_free(other)
    assert is_free(run)


def test_a_run_that_is_gone_meanwhile_is_one_sentence(opened, run, other, gate, idle):
    moved = other.rename(other.with_name("gone"))
    gate.open.set()
    idle()
    moved.rename(other)
    assert "other is not there any more" in opened.findChild(QMessageBox, "error").text()
    assert opened.session.scene.run.path == run


def test_a_run_that_another_window_holds_opens_to_be_looked_at(window, run, idle):
    session = Session()
    session.open_scene(FakeScene(run))
    on.documents(window).open_path(run)
    idle()
    assert "is open in another window" in window.session.store.problem
    assert window.session.scene.run.path == run
    session.close()
    window.status.notice.linkActivated.emit("Open again")
    idle()
    assert not window.session.store.problem
    assert not is_free(run)
