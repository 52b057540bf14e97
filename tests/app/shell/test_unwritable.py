"""A clip that cannot be written, a full disk, two windows: work goes to the journal, nothing gets in the hand's way, nothing is lost."""

from __future__ import annotations

import resource
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog, QMessageBox

from degense.app.application import FEATURES
from degense.app.session.state_folder import left_behind
from degense.app.shell.settings import SettingsFile
from degense.app.shell.shell import Shell
from degense.engine.annotation.folder import INDEX, NAME
from tests.app import installed as on
from tests.app.shell.test_nothing_lost import click

#: A folder in which not even the superuser can make anything.
UNWRITABLE = Path("/sys/kernel")


@pytest.fixture
def clip(tiny_clip: Path, tmp_path: Path) -> Path:
    """A copy of the clip, without labels of its own."""
    copy = shutil.copytree(tiny_clip, tmp_path / "clip")
    shutil.rmtree(copy / "labels", ignore_errors=True)
    return copy


def annotate(qtbot, window: Shell, clip: Path) -> None:
    """Open a clip in a window, as the user would, with the brush in hand."""
    on.documents(window).open_path(clip)
    qtbot.waitUntil(lambda: window.worker.idle("diagnostics"))
    for box in window.findChildren(QMessageBox):
        click(qtbot, box, "Restore")
    if not on.annotations(window).tool.active:
        window.registry.run("annotate.mode")
    on.annotations(window).tool.choose(radius=3.0)
    qtbot.waitUntil(lambda: window.worker.idle("diagnostics") and on.viewer(window).panel._frame is not None)


def mouse(window: Shell, kind: QEvent.Type, x: float, y: float, buttons: Qt.MouseButton) -> None:
    panel = on.viewer(window).panel
    place = panel.zoom.to_widget(QPointF(x, y))
    button = Qt.MouseButton.NoButton if kind == QEvent.Type.MouseMove else Qt.MouseButton.LeftButton
    QApplication.sendEvent(panel, QMouseEvent(kind, place, panel.mapToGlobal(place), button, buttons, Qt.KeyboardModifier.NoModifier))


def stroke(window: Shell, y: float, end: bool = True) -> None:
    """Paint from left to right."""
    left = Qt.MouseButton.LeftButton
    mouse(window, QEvent.Type.MouseButtonPress, 10, y, left)
    for x in range(11, 60):
        mouse(window, QEvent.Type.MouseMove, x, y, left)
    if end:
        mouse(window, QEvent.Type.MouseButtonRelease, 60, y, Qt.MouseButton.NoButton)


def painted(window: Shell, *rows: int) -> bool:
    labels = on.annotations(window).labels(0)
    return all((labels[row, 10:59] == 0).all() for row in rows)


@contextmanager
def full_disk() -> Iterator[None]:
    """No file grows beyond 1 kB."""
    old, limit = signal.signal(signal.SIGXFSZ, signal.SIG_IGN), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 10, limit[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, old)


@pytest.fixture
def another(qtbot, tmp_path):
    """Opens further windows, as the next start would."""

    def open_window() -> Shell:
        window = Shell(SettingsFile(tmp_path / "settings.json"), FEATURES)
        qtbot.addWidget(window)
        with qtbot.waitSignal(on.viewer(window).splats_added):
            window.show()
        window.activateWindow()
        return window

    return open_window


def test_painting_on_a_clip_that_cannot_be_written(qtbot, window, clip, another, tmp_path, monkeypatch, screenshot):
    (clip / NAME).symlink_to(UNWRITABLE)
    annotate(qtbot, window, clip)
    view = on.viewer(window).panel.geometry()
    stroke(window, 20, end=False)
    window.ticked.emit()
    assert window.findChildren(QMessageBox) == []  # nothing opens amid the stroke
    assert on.viewer(window).panel.geometry() == view  # and nothing moves
    assert "cannot be written" in window.status.notice.text()
    mouse(window, QEvent.Type.MouseButtonRelease, 60, 20, Qt.MouseButton.NoButton)
    screenshot(window, "unwritable")
    stroke(window, 40)
    assert painted(window, 20, 40)
    window.registry.run("file.save")
    assert window.isWindowModified()
    qtbot.keyClick(window, Qt.Key.Key_Q, Qt.KeyboardModifier.ControlModifier)
    box = window.findChild(QMessageBox, "unsaved")
    assert "offered at the next start" in box.informativeText()
    screenshot(window, "unwritable-leaving")
    click(qtbot, box, "Stay")
    assert window.isVisible()
    qtbot.waitUntil(lambda: window.findChild(QMessageBox, "unsaved") is None)
    window.close()
    click(qtbot, window.findChild(QMessageBox, "unsaved"), "Leave")
    qtbot.waitUntil(lambda: not window.isVisible())
    assert left_behind() == [clip]

    again = another()
    annotate(qtbot, again, left_behind()[0])  # and restores what is offered
    assert painted(again, 20, 40)
    stroke(again, 60)
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *args: str(tmp_path))
    again.status.notice.linkActivated.emit("Save elsewhere…")
    assert (tmp_path / "clip-annotations" / INDEX).is_file()
    assert not again.status.notice.isVisible()
    assert not again.isWindowModified()
    again.close()
    last = another()
    annotate(qtbot, last, clip)
    assert painted(last, 20, 40, 60)
    last.close()


def test_a_button_that_goes_up_elsewhere_ends_the_stroke(qtbot, window, clip):
    annotate(qtbot, window, clip)
    stroke(window, 20, end=False)
    mouse(window, QEvent.Type.MouseMove, 80, 70, Qt.MouseButton.NoButton)  # a dialog took the release
    mouse(window, QEvent.Type.MouseMove, 10, 70, Qt.MouseButton.NoButton)
    assert painted(window, 20)
    assert (on.annotations(window).labels(0)[30:] == 255).all()  # no bar to where the mouse is now
    assert window.session.undo.entries == ("Paint in frame 0",)


def strokes_and_save(window: Shell) -> None:
    """More strokes than a full disk has room for, and an attempt to save them."""
    for row in range(18, 70, 4):
        stroke(window, row)
    window.registry.run("file.save")


def test_a_full_disk_amid_painting(qtbot, window, clip, another):
    annotate(qtbot, window, clip)
    stroke(window, 12)
    with full_disk():
        strokes_and_save(window)
        window.ticked.emit()
        assert window.findChildren(QMessageBox) == []
        assert "cannot be written" in window.status.notice.text()
        window.close()
        box = window.findChild(QMessageBox, "unsaved")
        assert "lost when you leave" in box.informativeText()
        click(qtbot, box, "Stay")
    window.ticked.emit()  # there is room again
    assert window.session.store.journaled
    window.registry.run("file.save")
    assert not window.status.notice.isVisible()
    window.registry.run("file.close")
    assert window.session.clip is None
    window.close()
    again = another()
    annotate(qtbot, again, clip)
    assert painted(again, *range(18, 70, 4))
    again.close()


@pytest.fixture
def chosen(monkeypatch, tmp_path) -> Path:
    """The folder that the user chooses in the system's dialog."""
    folder = tmp_path / "usb"
    folder.mkdir()
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *args: str(folder))
    return folder


def click_link(window: Shell) -> None:
    """Click what the notice in the status bar offers, with the mouse of the window system."""
    notice = window.status.notice
    assert notice.text().startswith("<a href='Save elsewhere…'>")
    QApplication.processEvents()  # the bar is laid out
    at = notice.mapTo(window, QPoint(12, notice.height() // 2))
    QTest.mouseMove(window.windowHandle(), at)
    QTest.mouseClick(window.windowHandle(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, at)


def test_save_elsewhere_while_the_disk_is_full(qtbot, window, clip, another, chosen, screenshot):
    """Clicked while there is room nowhere it says so and loses nothing; clicked again with room there it saves."""
    annotate(qtbot, window, clip)
    stroke(window, 12)
    with full_disk():
        strokes_and_save(window)
        assert "cannot be written" in window.status.notice.text()
        click_link(window)
        box = window.findChild(QMessageBox, "error")
        assert str(chosen) in box.text()
        assert "cannot be written" in box.text()
        click(qtbot, box, "OK")
        qtbot.waitUntil(lambda: window.findChild(QMessageBox, "error") is None)
        assert window.isWindowModified()
        assert window.session.store.folder == clip / NAME
    screenshot(window, "full-disk")  # which takes room itself
    click_link(window)
    assert not window.status.notice.isVisible()
    assert not window.isWindowModified()
    folder = window.session.store.folder
    assert (folder.parent, (folder / INDEX).is_file()) == (chosen, True)
    assert window.statusBar().currentMessage().startswith(f"Saved in {folder}")
    window.close()
    again = another()
    annotate(qtbot, again, clip)
    assert painted(again, 12, *range(18, 70, 4))
    again.close()


def test_save_elsewhere_when_the_folder_has_vanished(qtbot, window, clip, another, chosen, tmp_path, screenshot):
    annotate(qtbot, window, clip)
    stroke(window, 20)
    window.registry.run("file.save")
    clip.rename(tmp_path / "unplugged")
    stroke(window, 40)
    window.ticked.emit()
    assert window.findChildren(QMessageBox) == []
    assert "gone or read-only" in window.status.notice.text()
    screenshot(window, "vanished")
    click_link(window)
    assert (chosen / "clip-annotations" / INDEX).is_file()
    assert not window.status.notice.isVisible()
    assert not window.isWindowModified()
    stroke(window, 60)  # goes there from now on
    window.registry.run("file.save")
    window.close()
    qtbot.waitUntil(lambda: not window.isVisible())
    (tmp_path / "unplugged").rename(clip)
    again = another()
    annotate(qtbot, again, clip)
    assert painted(again, 20, 40, 60)
    again.close()


def test_save_elsewhere_on_leaving(qtbot, window, clip, another, chosen):
    (clip / NAME).symlink_to(UNWRITABLE)
    annotate(qtbot, window, clip)
    stroke(window, 20)
    qtbot.keyClick(window, Qt.Key.Key_Q, Qt.KeyboardModifier.ControlModifier)
    click(qtbot, window.findChild(QMessageBox, "unsaved"), "Save elsewhere")
    qtbot.waitUntil(lambda: not window.isVisible())  # it was saved, so the window closes
    assert (chosen / "clip-annotations" / INDEX).is_file()
    assert left_behind() == []
    again = another()
    annotate(qtbot, again, clip)
    assert painted(again, 20)
    again.close()


def test_two_windows_on_a_clip(qtbot, window, clip, another, screenshot):
    annotate(qtbot, window, clip)
    stroke(window, 20)
    second = another()
    annotate(qtbot, second, clip)
    assert "is open in another window" in second.status.notice.text()
    stroke(second, 40)
    screenshot(second, "two-windows")
    assert on.annotations(second).work.records == {}
    second.settings.update(speed=2.0)
    window.settings.update(theme="light")
    window.close()
    second.status.notice.linkActivated.emit("Open again")
    annotate(qtbot, second, clip)
    assert not second.status.notice.isVisible()
    assert painted(second, 20)
    stroke(second, 40)
    second.close()
    settings = SettingsFile(second.settings.path).value
    assert (settings.speed, settings.theme) == (2.0, "light")
    assert np.count_nonzero([path.suffix == ".png" for path in (clip / NAME).iterdir()]) == 1
