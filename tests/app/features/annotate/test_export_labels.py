"""Task: hand masks or annotations over to another tool, with the dialog of File ▸ Export."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox

from degense.app.features.annotate.label_sets import label_format
from degense.app.features.export.label_dialog import LabelExportDialog
from degense.app.features.export.label_offers import LabelPlan
from tests.app import installed as on


@pytest.fixture
def dialog(qtbot, opened, idle) -> LabelExportDialog:
    """The dialog over the tiny run, opened with its keys at frame 4."""
    opened.session.go_to(4)
    idle()
    QTest.keyClick(opened, Qt.Key.Key_E, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier)
    found = opened.findChild(LabelExportDialog)
    assert found is not None
    qtbot.waitUntil(found.isVisible)
    return found


def pick(box: QComboBox, value: str) -> None:
    """Choose an entry with the arrow keys."""
    box.setFocus()
    while (step := box.findData(value) - box.currentIndex()) != 0:
        QTest.keyClick(box, Qt.Key.Key_Down if step > 0 else Qt.Key.Key_Up)


def type_path(dialog: LabelExportDialog, path) -> None:
    line = dialog.path.line
    line.setFocus()
    line.selectAll()
    QTest.keyClicks(line, str(path))


def press(dialog: LabelExportDialog) -> None:
    assert dialog.start.isEnabled()
    QTest.mouseClick(dialog.start, Qt.MouseButton.LeftButton)


def test_annotations_of_a_range_go_to_label_studio(opened, dialog, idle, tmp_path, screenshot):
    assert dialog.source.currentData() == "annotations"  # the clip came with labels
    pick(dialog.format, "label-studio")
    pick(dialog.frames, "range")
    dialog.first.setFocus()
    QTest.keyClick(dialog.first, Qt.Key.Key_Up)
    QTest.keyClick(dialog.first, Qt.Key.Key_Up)
    dialog.last.selectAll()
    QTest.keyClicks(dialog.last, "4\t")
    type_path(dialog, tmp_path / "a.json")
    assert dialog.sentence.text().startswith("Writes 3 label maps of 8 classes (")
    assert dialog.sentence.text().endswith(f"into the file {tmp_path / 'a.json'}.")
    screenshot(dialog, "export-labels")
    press(dialog)
    idle()
    assert [task["id"] for task in json.loads((tmp_path / "a.json").read_text())] == [3, 4, 5]
    assert opened.statusBar().currentMessage() == f"Saved {tmp_path / 'a.json'}: 3 label maps of 8 classes"
    assert opened.findChild(LabelExportDialog) is None or not opened.findChild(LabelExportDialog).isVisible()


def test_masks_of_prompts_in_this_frame(opened, idle, tmp_path, qtbot):
    opened.session.view.add_prompt("liver")
    opened.session.go_to(4)
    idle()
    opened.registry.run("export.labels")
    dialog = opened.findChild(LabelExportDialog)
    pick(dialog.source, "masks")
    assert dialog.source.currentText() == "masks of the visible prompts"
    pick(dialog.format, "coco")
    pick(dialog.frames, "this")
    type_path(dialog, tmp_path / "a.json")
    press(dialog)
    idle()
    clip, scene = opened.session.clip, opened.session.scene
    again = label_format("coco").read(tmp_path / "a.json", (80, 96), tuple(f"{i:06d}" for i in range(10)))
    from degense.engine.scene.clip_query import decode_frame

    assert again.frames == (4,)
    assert np.array_equal(again.read(4), decode_frame(scene, opened.session.view_state.prompt_set, 4).labels)
    assert clip.labels(4) is not None


def test_what_cannot_be_written_is_said_before(dialog, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    pick(dialog.format, "masks-png")
    type_path(dialog, tmp_path)
    assert dialog.complaint.text() == f"{tmp_path} is not empty; choose another folder."
    assert not dialog.start.isEnabled()
    pick(dialog.format, "coco")
    assert dialog.path.line.text().endswith("-coco.json")  # each format proposes its own name
    type_path(dialog, tmp_path / "mine.txt")
    assert dialog.sentence.text().endswith("in place of the file that is there.")
    dialog.reject()


def test_closing_the_dialog_stops_the_export(opened, dialog, idle, tmp_path):
    pick(dialog.format, "masks-png")
    type_path(dialog, tmp_path / "masks")
    press(dialog)
    assert not dialog.start.isEnabled()
    assert dialog.bar.isVisible()
    QTest.keyClick(dialog, Qt.Key.Key_Escape)
    idle()
    opened.worker.submit("export", lambda: None, lambda nothing: None, lambda message: None)  # waits until the stopped one has cleaned up
    idle()
    assert list(tmp_path.glob("masks*")) == []
    assert list(tmp_path.glob(".masks*")) == []


def test_a_plan_counts_what_has_labels(opened, dialog):
    plan = dialog.plan
    narrower = LabelPlan(plan.offer, plan.kind, (2, 99), plan.out)
    assert narrower.written == (2,)
    assert "1 label map (2 frames are chosen, the others have no labels)" in narrower.sentence
    assert LabelPlan(plan.offer, plan.kind, (99,), plan.out).problem.startswith("None of these frames is labelled")
    assert on.annotations(opened).labelled_frames() == tuple(range(10))
    dialog.reject()
