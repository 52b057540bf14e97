"""Task: label a frame by hand, propagate it to the others, review, undo, save, hand over."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtWidgets import QMessageBox, QPushButton, QTabWidget

from degense.app.features.annotate.label_sets import label_format
from degense.app.session.state_folder import JOURNAL, folder_of
from degense.engine.annotation.annotations import Record
from degense.engine.annotation.edits import Proposal
from degense.engine.annotation.folder import NAME
from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import open_clip
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet
from tests.app import installed as on
from tests.app.painting import annotating as annotating_session
from tests.app.shell.test_nothing_lost import click


@pytest.fixture
def annotating(qtbot, opened, idle):
    """The window with the tiny run, annotating frame 4, with a brush of 4 pixels and classes as the clip has them."""
    opened.session.go_to(4)
    on.viewer(opened).panel.setFocus()
    qtbot.keyClick(on.viewer(opened).panel, Qt.Key.Key_A)
    on.annotations(opened).tool.choose(radius=4.0)
    idle()
    return opened


def at(window, x: float, y: float) -> QPoint:
    return on.viewer(window).panel.zoom.to_widget(QPointF(x, y)).toPoint()


def drag(qtbot, window, *points: tuple[float, float]) -> None:
    panel = on.viewer(window).panel
    qtbot.mousePress(panel, Qt.MouseButton.LeftButton, pos=at(window, *points[0]))
    for point in points[1:]:
        qtbot.mouseMove(panel, at(window, *point))
    qtbot.mouseRelease(panel, Qt.MouseButton.LeftButton, pos=at(window, *points[-1]))


def press(qtbot, window, action: str) -> None:
    button = on.annotator(window).panel.buttons[action]
    assert isinstance(button, QPushButton)
    pages = on.annotator(window).panel.findChild(QTabWidget)
    if (page := next((i for i in range(pages.count()) if pages.widget(i).isAncestorOf(button)), None)) is not None:
        qtbot.mouseClick(pages.tabBar(), Qt.MouseButton.LeftButton, pos=pages.tabBar().tabRect(page).center())
    assert button.isEnabled()
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def labels(window) -> np.ndarray:
    return on.annotations(window).labels(window.session.frame)


def test_painting_and_erasing_are_undone_by_name(qtbot, annotating, idle, screenshot):
    window, panel, state = annotating, on.viewer(annotating).panel, on.annotations(annotating)
    came = window.session.clip.labels(4)
    assert np.array_equal(labels(window), came)
    recorded = on.viewer(window).view.rgb
    assert np.array_equal(recorded, window.session.clip.frame(4))  # one labels what was recorded
    qtbot.keyClick(panel, Qt.Key.Key_7)
    assert state.tool.label == 6
    assert window.session.view_state.layer == "rgb"  # 7 is a class now, not a layer
    drag(qtbot, window, (20, 20), (50, 20))
    painted = labels(window) == 6
    assert painted[20, 18:52].all()
    assert 250 < (painted & (came != 6)).sum() < 400
    shown = panel.grab_image().astype(int)
    assert np.abs(shown - recorded)[20, 25:45].max() > 20
    qtbot.keyClick(panel, Qt.Key.Key_E)
    drag(qtbot, window, (30, 20), (30, 20.6))
    assert (labels(window)[18:22, 28:32] == UNLABELLED).all()
    assert window.session.undo.entries == ("Paint in frame 4", "Erase in frame 4")
    qtbot.keyClick(panel, Qt.Key.Key_Left)
    qtbot.keyClick(panel, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    qtbot.keyClick(panel, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)  # survives the change of frame
    assert np.array_equal(state.labels(4), came)
    window.registry.run("edit.redo")
    qtbot.keyClick(panel, Qt.Key.Key_Right)
    idle()
    assert np.array_equal(labels(window) == 6, painted)
    screenshot(window, "annotate-brush")


def test_brush_sizes_and_keys_that_type(qtbot, annotating):
    window, state = annotating, on.annotations(annotating)
    qtbot.keyClick(on.viewer(window).panel, Qt.Key.Key_BracketRight)
    assert state.tool.radius == pytest.approx(4 * 2**0.25)
    qtbot.keyClick(on.viewer(window).panel, Qt.Key.Key_BracketLeft)
    assert state.tool.radius == pytest.approx(4)
    field = on.annotator(window).panel._new
    field.setFocus()
    qtbot.keyClicks(field, "clip 2 ]r")
    qtbot.keyClick(field, Qt.Key.Key_Return)
    assert state.work.classes[-1].name == "clip 2 ]r"
    assert state.tool.label == len(state.work.classes) - 1
    assert state.tool.radius == pytest.approx(4)
    assert state.tool.name == "brush"
    window.registry.run("edit.undo")
    assert on.annotator(window).panel.classes.names == list(window.session.scene.classes)
    panel = on.annotator(window).panel.classes
    panel.item(0).setText("bowel")
    assert state.work.classes[0].name == "bowel"
    panel.item(0).setText(state.work.classes[1].name)  # taken
    assert panel.item(0).text() == "bowel"


def test_polygon_fill_superpixels_holes_and_lock(qtbot, annotating, screenshot):
    window, panel, state = annotating, on.viewer(annotating).panel, on.annotations(annotating)
    work = state.work
    qtbot.keyClick(panel, Qt.Key.Key_U)
    qtbot.keyClick(panel, Qt.Key.Key_8)
    for corner in ((10, 10), (40, 10), (40, 40), (60, 70)):
        qtbot.mouseClick(panel, Qt.MouseButton.LeftButton, pos=at(window, *corner))
    qtbot.keyClick(panel, Qt.Key.Key_Backspace)
    qtbot.mouseClick(panel, Qt.MouseButton.LeftButton, pos=at(window, 10, 40))
    screenshot(window, "annotate-polygon")
    qtbot.keyClick(panel, Qt.Key.Key_Return)
    assert (labels(window)[12:38, 12:38] == 7).all()
    assert (labels(window) == 7).sum() < 34 * 34
    qtbot.keyClick(panel, Qt.Key.Key_B)
    qtbot.keyClick(panel, Qt.Key.Key_1)
    drag(qtbot, window, (25, 25), (26, 25))
    qtbot.keyClick(panel, Qt.Key.Key_8)
    press(qtbot, window, "annotate.holes")
    assert (labels(window)[12:38, 12:38] == 7).all()
    state.tool.lock(7)
    qtbot.keyClick(panel, Qt.Key.Key_2)
    before = labels(window).copy()
    drag(qtbot, window, (30, 30), (90, 30))
    changed = labels(window) != before
    assert changed.any()
    assert (before[changed] == 7).all()
    state.tool.lock(None)
    qtbot.keyClick(panel, Qt.Key.Key_G)
    qtbot.keyClick(panel, Qt.Key.Key_3)
    qtbot.mouseClick(panel, Qt.MouseButton.LeftButton, pos=at(window, 15.5, 15.5))
    assert (labels(window)[12:20, 12:20] == 2).all()
    qtbot.keyClick(panel, Qt.Key.Key_S)
    qtbot.keyClick(panel, Qt.Key.Key_5)
    state.tool.choose(radius=0.5)
    drag(qtbot, window, (70, 60), (70.5, 60))
    region = on.annotator(window).painter.superpixels()[60, 70]
    assert ((labels(window) == 4) >= (on.annotator(window).painter.superpixels() == region)).all()
    assert work.record(4).by_hand


def test_a_frame_is_propagated_reviewed_and_taken_back(qtbot, annotating, idle, screenshot):
    window, panel, state = annotating, on.viewer(annotating).panel, on.annotations(annotating)
    press(qtbot, window, "annotate.propagate")
    box = window.findChild(QMessageBox, "labelled frames")
    assert "9 of the other frames have labels" in box.text()  # the clip came with them
    assert [button.text() for button in box.buttons()] == ["Propose new ones", "Cancel"]
    click(qtbot, box, "Propose new ones")
    assert on.annotator(window).panel.buttons["annotate.stop"].isEnabled()
    idle()
    assert state.work.waiting() == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert "9 wait for an answer" in on.annotator(window).panel.summary.text()
    for frame in state.work.waiting():
        found = state.work.record(frame).proposal
        state.work.records[frame] = Record(proposal=Proposal(found.packed, found.shape, 0.5 if frame == 7 else 0.9))
    qtbot.keyClick(panel, Qt.Key.Key_N)
    assert window.session.frame == 7
    idle()
    assert "proposed, confidence 50%" in on.annotator(window).panel.frame.text()
    screenshot(window, "annotate-review")
    truth = window.session.clip.labels(7)
    assert (labels(window) == truth).mean() > 0.8
    press(qtbot, window, "annotate.reject")
    assert np.array_equal(labels(window), truth)  # what it came with
    window.session.go_to(5)
    qtbot.keyClick(panel, Qt.Key.Key_Y)
    assert state.work.record(5).status == "done"
    press(qtbot, window, "annotate.accept-all")
    assert state.work.waiting() == []
    qtbot.keyClick(panel, Qt.Key.Key_F, Qt.KeyboardModifier.ShiftModifier)
    assert state.work.record(5).status == "flagged"
    names = window.session.undo.entries
    assert names == ("Propagate labels to 9 frames", "Reject frame 7", "Accept frame 5", "Accept 7 frames", "Frame 5: flagged")
    window.session.undo.go_to(1)
    press(qtbot, window, "annotate.accept")
    press(qtbot, window, "annotate.reject-all")
    assert (state.work.waiting(), state.work.record(5).status) == ([], "done")
    window.session.undo.go_to(0)
    assert state.work.records == {}


def test_propagating_can_be_stopped(qtbot, annotating, idle):
    window = annotating
    press(qtbot, window, "annotate.propagate")
    click(qtbot, window.findChild(QMessageBox, "labelled frames"), "Propose new ones")
    press(qtbot, window, "annotate.stop")
    idle()
    assert on.annotations(window).work.records == {}
    assert on.annotator(window).panel.buttons["annotate.propagate"].isEnabled()


def test_masks_of_prompts_are_where_painting_starts(qtbot, annotating, idle):
    window = annotating
    window.session.view.add_prompt("liver")
    idle()
    press(qtbot, window, "annotate.prompt")
    idle()
    scene = window.session.scene
    mask = decode_frame(scene, PromptSet(("liver",)), 4).masks[0]
    assert (labels(window)[mask] == scene.classes.index("liver")).all()
    assert window.session.undo.undo_name == "Mask of liver in frame 4"


def test_annotations_are_saved_opened_again_and_handed_over(qtbot, annotating, run, idle, tmp_path):
    window, state = annotating, on.annotations(annotating)
    qtbot.keyClick(on.viewer(window).panel, Qt.Key.Key_7)
    drag(qtbot, window, (20, 20), (50, 20))
    painted = labels(window).copy()
    assert window.isWindowModified()
    window.registry.run("file.save")
    assert not window.isWindowModified()
    assert len(list((run / NAME).glob("000004-*.png"))) == 1
    on.documents(window).open_path(run)
    idle()
    assert np.array_equal(state.labels(4), painted)
    list(label_format("cvat").write(state.snapshot(), tmp_path / "a.xml"))
    again = label_format("cvat").read(tmp_path / "a.xml", state.work.shape, tuple(f"{i:06d}" for i in range(10)))
    assert np.array_equal(again.read(4), painted)
    window.session.go_to(0)
    on.exchange(window).take("cvat", tmp_path / "a.xml")
    idle()
    assert window.session.undo.undo_name == "Import a.xml"
    assert np.array_equal(state.labels(4), painted)
    assert len(state.work.records) == 10
    window.registry.run("annotate.teach")
    idle()
    dialog = window.findChild(object, "train")
    job = dialog.job()
    assert job.teacher == "labels"
    assert job.labels == str(run / NAME / "teacher")
    dialog.reject()
    qtbot.waitUntil(lambda: window.findChild(object, "train") is None)


def test_a_clip_without_a_run_keeps_its_labels_beside_itself(qtbot, window, tiny_clip, idle, tmp_path):
    import shutil

    clip = tmp_path / "clip"
    shutil.copytree(tiny_clip / "images", clip / "images")
    on.documents(window).open_path(clip)
    idle()
    window.registry.run("annotate.mode")
    state = on.annotations(window)
    state.tool.choose(radius=5.0)
    drag(qtbot, window, (20, 20), (50, 20))
    assert state.work.records == {}  # there is no class yet
    state.add_class("grasper")
    drag(qtbot, window, (20, 20), (50, 20))
    assert (folder_of(clip / NAME) / JOURNAL).exists()
    assert window.isWindowModified()
    window.registry.run("file.save")
    assert (clip / NAME / "annotations.json").exists()
    assert not window.isWindowModified()
    painted = state.labels(0).copy()
    on.documents(window).open_path(clip)
    idle()
    assert np.array_equal(state.labels(0), painted)
    press = at(window, 30, 50)
    qtbot.mousePress(on.viewer(window).panel, Qt.MouseButton.LeftButton, pos=press)  # a stroke that does not end
    qtbot.wait(2200)
    shutil.copytree(clip, tmp_path / "killed")  # what is there if the program ends now
    journal = folder_of(tmp_path / "killed" / NAME) / JOURNAL
    journal.parent.mkdir()
    shutil.copyfile(folder_of(clip / NAME) / JOURNAL, journal)
    killed, labels = annotating_session()
    killed.open_clip(open_clip(tmp_path / "killed"))
    killed.recover()
    assert labels.labels(0)[50, 30] == 0
    assert np.array_equal(labels.labels(0), state.labels(0))
    killed.close()
    qtbot.mouseRelease(on.viewer(window).panel, Qt.MouseButton.LeftButton, pos=press)
    on.documents(window).open_path(clip)
    idle()
    assert state.labels(0)[50, 30] == 0
    (clip / NAME / "annotations.json").write_text("{")
    on.documents(window).open_path(clip)
    idle()
    assert state.work is None
    assert "cannot be read" in on.annotator(window).panel.summary.text()
    assert (clip / NAME / "annotations.json").read_text() == "{"
