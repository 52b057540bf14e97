"""A drive that is slow to take what is saved: the session goes on beside it, and nothing is lost whatever ends it when."""

from __future__ import annotations

import shutil
import threading

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QMessageBox

from degense.app.features.documents import saver
from degense.app.research.reliability.readers.sessions import opened_session
from degense.app.session import session_file
from degense.app.session.state_folder import folder_of
from degense.engine.annotation.painting import PixelRegion
from degense.engine.errors import DegenseError
from tests.app import installed as on


def dot(annotations, number: int) -> None:
    annotations.paint("Brush", PixelRegion(10, number, np.ones((1, 1), bool)), 1)


def dots(annotations) -> list[int]:
    return np.flatnonzero(annotations.labels(0)[10] == 1).tolist()


def names(annotations) -> list[str]:
    return [kind.name for kind in annotations.work.classes]


def again(folder, tmp_path):
    """What a program finds that starts now, while this one has ended without a word: it works on a copy."""
    copy = tmp_path / f"copy-{len(list(tmp_path.iterdir()))}"
    shutil.copytree(folder, copy)
    (state,) = (copy / "state" / "degense" / "sessions").iterdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(copy / "state"))
        shutil.move(state, folder_of(copy))
    session, annotations = opened_session(copy)
    if session.store.unsaved:
        session.recover()
    found = dots(annotations), names(annotations)
    session.close()
    return found


@pytest.fixture
def painted(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    session, annotations = opened_session(folder)
    dot(annotations, 1)
    session.save()
    dot(annotations, 2)
    yield folder, session, annotations
    session.close()


def test_what_is_done_while_it_is_saved_is_not_lost_whenever_the_program_ends(painted, tmp_path):
    folder, session, annotations = painted
    store = session.store
    saving = store.begin_save()
    assert again(folder, tmp_path)[0] == [1, 2]  # nothing is written yet
    dot(annotations, 3)
    annotations.add_class("kidney")
    assert again(folder, tmp_path) == ([1, 2, 3], names(annotations))
    saving.write()
    assert "kidney" not in (folder / "annotations" / "annotations.json").read_text(encoding="utf-8")
    assert again(folder, tmp_path) == ([1, 2, 3], names(annotations))  # written, and not ended
    store.end_save(saving)
    assert session.dirty
    assert again(folder, tmp_path) == ([1, 2, 3], names(annotations))
    dot(annotations, 4)
    assert again(folder, tmp_path)[0] == [1, 2, 3, 4]
    session.save()
    assert not session.dirty
    assert again(folder, tmp_path)[0] == [1, 2, 3, 4]
    assert not list((folder / "state").rglob("session.journal"))


def test_a_save_that_fails_leaves_all_in_the_journal(painted, tmp_path, monkeypatch):
    folder, session, annotations = painted
    saving = session.store.begin_save()
    dot(annotations, 3)
    error = DegenseError("the drive is gone")
    session.store.fail_save(saving, error)
    assert (session.dirty, session.store.problem) == (True, str(error))
    dot(annotations, 4)
    assert again(folder, tmp_path)[0] == [1, 2, 3, 4]
    session.save()
    assert (session.dirty, session.store.problem) == (False, "")
    assert again(folder, tmp_path)[0] == [1, 2, 3, 4]


def test_a_save_of_what_is_no_longer_open_changes_nothing(painted):
    folder, session, annotations = painted
    saving = session.store.begin_save()
    saving.write()
    session.close()
    session, annotations = opened_session(folder)
    dot(annotations, 5)
    session.store.end_save(saving)
    assert session.dirty
    assert dots(annotations) == [1, 2, 5]
    session.close()


@pytest.fixture
def slow(monkeypatch):
    """The drive takes nothing until this is set."""
    taken = threading.Event()

    def write(path, saved, write=session_file.write):
        assert taken.wait(60)
        write(path, saved)

    monkeypatch.setattr(session_file, "write", write)
    monkeypatch.setattr(saver, "PATIENCE", 0.05)
    yield taken
    taken.set()


def test_the_window_goes_on_while_it_saves_and_closes_when_that_is_done(qtbot, opened, run, idle, slow):
    autosave = on.autosave(opened)
    opened.session.view.add_prompt("liver")
    opened.registry.run("file.save")
    assert "is slow" in opened.statusBar().currentMessage()
    opened.session.view.add_prompt("grasper")
    opened.session.go_to(4)
    idle()
    assert on.viewer(opened).view.frame == 4
    opened.close()
    assert opened.isVisible()
    assert opened.findChild(QMessageBox, "unsaved") is None
    slow.set()
    qtbot.waitUntil(lambda: not opened.isVisible())
    assert not autosave.saver.running
    prompts = session_file.read(run / "session.json").states["look"]
    assert "liver" in str(prompts)
    assert "grasper" in str(prompts)


def test_whoever_leaves_twice_is_asked(qtbot, opened, run, idle, slow):
    opened.session.view.add_prompt("liver")
    opened.close()
    assert opened.isVisible()
    opened.close()
    box = opened.findChild(QMessageBox, "unsaved")
    assert "does not answer" in box.text()
    qtbot.mouseClick(next(button for button in box.buttons() if "Stay" in button.text()), Qt.MouseButton.LeftButton)
    slow.set()
    qtbot.waitUntil(lambda: not on.autosave(opened).saver.running)
    assert opened.isVisible()
    assert not opened.isWindowModified()
