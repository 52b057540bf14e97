"""The dialogs of exports hand over what names no patient, with burnt-in text blacked out that was drawn or chosen."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton

from degense.app.features.anonymise.cover_drawing import CoverDialog
from degense.app.features.anonymise.file_dialog import FileDialog
from degense.app.features.export.label_dialog import LabelExportDialog
from degense.app.features.movies.dialog import MovieDialog
from degense.widgets import forms
from tests.app import installed as on
from tests.app.privacy.test_anonymise import NAME, assert_nameless

CONTROL, ALT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.AltModifier
#: What is drawn over, pixels: rows and columns.
COVERED = (slice(0, 10), slice(0, 40))


@pytest.fixture
def named(window, idle, run, tiny_clip, tmp_path):
    """The window with a run whose folders bear a name."""
    home = tmp_path / NAME
    shutil.copytree(tiny_clip, home / f"{NAME}-clip")
    shutil.copytree(run, home / f"{NAME}-run")
    file = home / f"{NAME}-run" / "run.json"
    info = json.loads(file.read_text(encoding="utf-8"))
    info["clip"]["path"] = str(home / f"{NAME}-clip")
    file.write_text(json.dumps(info), encoding="utf-8")
    on.documents(window).open_path(home / f"{NAME}-run")
    idle()
    assert window.session.clip is not None
    window.session.go_to(3)
    idle()
    return window


def dialog_of(qtbot, window, kind: type, letter: Qt.Key):
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    on.viewer(window).panel.setFocus()
    QTest.keyClick(window.windowHandle(), letter, CONTROL | ALT)
    found = [dialog for dialog in window.findChildren(kind) if dialog.isVisible()]
    assert found
    found[-1].activateWindow()
    qtbot.waitUntil(found[-1].isActiveWindow)
    return found[-1]


def tick(dialog) -> None:
    dialog.anonymise.check.setFocus()
    QTest.keyClick(dialog.windowHandle(), Qt.Key.Key_Space)
    assert dialog.anonymise.check.isChecked()


def drag(widget, start: QPoint, end: QPoint) -> None:
    """With the mouse, by way of the window system."""
    top = widget.window().windowHandle()
    start, end = (widget.mapTo(widget.window(), point) for point in (start, end))
    QTest.mousePress(top, Qt.MouseButton.LeftButton, pos=start)
    QTest.mouseMove(top, (start + end) / 2)
    QTest.mouseMove(top, end)
    QTest.mouseRelease(top, Qt.MouseButton.LeftButton, pos=end)


def draw_cover(qtbot, dialog, screenshot=None) -> None:
    """Drag a rectangle over the corner, and add a second one by its numbers, with keys."""
    QTest.mouseClick(dialog.anonymise.draw, Qt.MouseButton.LeftButton)
    [cover] = dialog.findChildren(CoverDialog)
    cover.activateWindow()
    qtbot.waitUntil(cover.isActiveWindow)
    place = cover.drawing._place()
    scale = place.width() / 96
    corner = place.topLeft().toPoint()
    drag(cover.drawing, corner + QPoint(1, 1), corner + QPoint(round(25 * scale), round(9.5 * scale)))
    assert [(left, top) for left, top, *_ in cover.drawing.rectangles] == [(0, 0)]
    for number, value in zip(cover.numbers, (20, 0, 20, 10), strict=True):
        number.setFocus()
        number.selectAll()
        QTest.keyClicks(number, f"{value}\t")
    next(b for b in cover.findChildren(QAbstractButton) if b.text() == "Add").setFocus()
    QTest.keyClick(cover.windowHandle(), Qt.Key.Key_Space)
    assert cover.sentence.text() == "2 rectangles, black in every frame."
    if screenshot is not None:
        screenshot(cover, "cover")
    QTest.keyClick(cover.windowHandle(), Qt.Key.Key_Tab)
    cover.numbers[0].setFocus()
    QTest.keyClick(cover.windowHandle(), Qt.Key.Key_Return)  # Use this
    assert dialog.anonymise.value().cover is not None
    assert dialog.anonymise.value().cover[COVERED].all()
    assert dialog.anonymise.words.text() == "Blacked out: 5.2% of the picture"


def write_to(dialog, path: Path) -> None:
    dialog.path.line.setFocus()
    dialog.path.line.selectAll()
    QTest.keyClicks(dialog.path.line, str(path))
    QTest.keyClick(dialog.windowHandle(), Qt.Key.Key_Return)


def test_a_report(qtbot, named, idle, tmp_path, screenshot):
    named.session.view.add_prompt("liver")
    on.events(named).state.put(6, "clip applied")
    idle()
    dialog = dialog_of(qtbot, named, FileDialog, Qt.Key.Key_R)
    write_to(dialog, tmp_path / "plain.html")
    idle()
    assert NAME in (tmp_path / "plain.html").read_text(encoding="utf-8")  # so that the test would find it
    dialog = dialog_of(qtbot, named, FileDialog, Qt.Key.Key_R)
    tick(dialog)
    assert dialog.path.line.text().endswith("/report.html")
    draw_cover(qtbot, dialog, screenshot)
    screenshot(dialog, "report-dialog")
    write_to(dialog, tmp_path / "a.html")
    idle()
    assert_nameless(tmp_path / "a.html")
    found = re.findall(r"data:image/png;base64,([^\"]+)", (tmp_path / "a.html").read_text(encoding="utf-8"))
    shown = [np.array(Image.open(io.BytesIO(base64.b64decode(data)))) for data in found]
    assert len(shown) == 2  # the frame as it is shown, and the event
    for picture in shown:
        scale = picture.shape[1] // 96
        assert picture[: 10 * scale, : 40 * scale].max() == 0
        assert picture[12 * scale :].max() > 60


def test_a_shared_page(qtbot, named, idle, tmp_path, screenshot):
    """Its Gaussians cannot be covered: with something blacked out nothing is written, and the dialog says why."""

    def shared() -> FileDialog:
        named.registry.run("file.share")
        dialog = [dialog for dialog in named.findChildren(FileDialog) if dialog.isVisible()][-1]
        dialog.activateWindow()
        qtbot.waitUntil(dialog.isActiveWindow)
        return dialog

    named.session.view.add_prompt("liver")
    idle()
    write_to(shared(), tmp_path / "plain.html")
    idle()
    assert NAME in (tmp_path / "plain.html").read_text(encoding="utf-8")
    dialog = shared()
    assert NAME in dialog.path.line.text().rpartition("/")[2]
    tick(dialog)
    assert dialog.path.line.text().endswith("/scene.html")
    draw_cover(qtbot, dialog)
    write_to(dialog, tmp_path / "a.html")
    assert "Gaussians cannot be covered" in dialog.complaint.text()
    screenshot(dialog, "share-refused")
    assert not (tmp_path / "a.html").exists()
    QTest.mouseClick(dialog.anonymise.nothing, Qt.MouseButton.LeftButton)
    assert dialog.complaint.text() == ""
    write_to(dialog, tmp_path / "a.html")
    idle()
    assert_nameless(tmp_path / "a.html")
    assert '"masks":[{"text":"liver"' in (tmp_path / "a.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("kind", "name"), [("coco", "a.json"), ("dicom-seg", "a.dcm"), ("masks-png", "masks")])
def test_masks_and_annotations(qtbot, named, idle, tmp_path, kind, name, screenshot):
    dialog = dialog_of(qtbot, named, LabelExportDialog, Qt.Key.Key_E)
    forms.enter(dialog.format, kind)
    tick(dialog)
    assert NAME not in Path(dialog.path.line.text()).name
    screenshot(dialog, "export-anonymised")
    write_to(dialog, tmp_path / name)
    idle()
    assert_nameless(tmp_path / name)


def test_a_movie_with_a_mask_from_a_file(qtbot, named, idle, tmp_path, monkeypatch, screenshot):
    cover = np.zeros((80, 96), np.uint8)
    cover[COVERED] = 255
    cv2.imwrite(str(tmp_path / "cover.png"), cover)
    monkeypatch.setattr(named, "ask_open", lambda *words: tmp_path / "cover.png")
    monkeypatch.setattr(named, "ask_save", lambda *words: tmp_path / Path(words[1]).name)
    dialog = dialog_of(qtbot, named, MovieDialog, Qt.Key.Key_M)
    dialog.titled.setChecked(False)
    dialog.picture_width.setValue(192)  # also at another size than the clip's
    dialog.picture_height.setValue(160)
    tick(dialog)
    QTest.mouseClick(dialog.anonymise.choose, Qt.MouseButton.LeftButton)
    assert dialog.anonymise.words.text() == "Blacked out: 5.2% of the picture"
    screenshot(dialog, "movie-anonymised")
    QTest.mouseClick(dialog.start, Qt.MouseButton.LeftButton)
    idle()
    film = cv2.VideoCapture(str(tmp_path / "run-rgb.mp4"))
    ok, picture = film.read()
    film.release()
    assert ok
    assert picture.shape[:2] == (160, 192)
    assert picture[:16, :76].max() < 40
    assert picture[30:].max() > 100


def test_a_mask_of_another_size_is_refused(qtbot, named, tmp_path, monkeypatch):
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((4, 4), np.uint8))
    monkeypatch.setattr(named, "ask_open", lambda *words: tmp_path / "small.png")
    said = []
    monkeypatch.setattr(named, "show_error", said.append)
    dialog = dialog_of(qtbot, named, FileDialog, Qt.Key.Key_R)
    tick(dialog)
    QTest.mouseClick(dialog.anonymise.choose, Qt.MouseButton.LeftButton)
    assert "4 × 4 pixels" in said[0]
    assert dialog.anonymise.value().cover is None
    dialog.reject()
