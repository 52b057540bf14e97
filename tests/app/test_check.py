"""Task: check what was found in a clip on its pictures, and correct it before anything is written."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog

from app.clip_check import check_picture
from app.window.check_dialog import CheckDialog
from tests.fakes import MemoryClip


@pytest.fixture
def masked(tiny_clip, tmp_path) -> Path:
    """The tiny clip with masks in which white covers the left third: nobody can tell whether that is kept or left out."""
    clip = tmp_path / "masked"
    shutil.copytree(tiny_clip, clip)
    (clip / "masks").mkdir()
    mask = np.zeros((80, 96), np.uint8)
    mask[:, :32] = 255
    for file in (clip / "images").iterdir():
        cv2.imwrite(str(clip / "masks" / f"{file.stem}.png"), mask)
    return clip


def test_check_and_correct_a_clip(qtbot, window, masked, idle, monkeypatch, screenshot):
    before = {path: path.stat().st_mtime_ns for path in masked.rglob("*")}
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *args: str(masked))
    window.registry.run("file.open-clip")
    qtbot.waitUntil(lambda: window.findChild(CheckDialog) is not None, timeout=20_000)
    dialog = window.findChild(CheckDialog)

    def settled() -> None:
        qtbot.waitUntil(lambda: dialog.use.isEnabled() and not window.service.busy("check-picture"), timeout=20_000)

    settled()
    dialog.mask_means.setFocus(Qt.FocusReason.TabFocusReason)  # the picture follows the control
    assert dialog.aspect.currentData() == "masks"
    settled()
    left_out = window.session.clip.valid(0).mean()
    assert dialog.mask_means.currentData() is None
    screenshot(window, "check-masks")
    other = "keep" if left_out > 0.5 else "tool"
    dialog.mask_means.setCurrentIndex(dialog.mask_means.findData(other))
    assert not dialog.use.isEnabled()
    settled()
    assert dialog._clip.valid(0).mean() == pytest.approx(1 - left_out)
    dialog.focal.setValue(123.0)
    dialog.poses.setCurrentIndex(dialog.poses.findData("still"))
    settled()
    assert "123 px shows 43° across" in dialog.found["focal"].text()
    for aspect in ("depth", "labels"):
        dialog._turn_to(aspect)
        settled()
        screenshot(window, f"check-{aspect}")
    dialog.layout_choice.setCurrentIndex(dialog.layout_choice.findData("cholecseg8k"))
    qtbot.waitUntil(lambda: dialog.complaint.isVisible(), timeout=20_000)
    assert not dialog.use.isEnabled()
    dialog.layout_choice.setCurrentIndex(0)
    settled()
    assert {path: path.stat().st_mtime_ns for path in masked.rglob("*")} == before
    dialog.frame.setValue(3)
    settled()
    qtbot.mouseClick(dialog.use, Qt.MouseButton.LeftButton)
    idle()
    clip = window.session.clip
    assert clip.options == {"mask_means": other, "focal": 123.0, "poses": "still"}
    assert clip.cameras[0].fx == 123.0
    assert window.opening.clip_answers == clip.options  # the training begins with them
    window.registry.run("file.check")
    again = next(dialog for dialog in window.findChildren(CheckDialog) if dialog.isVisible())
    assert again.answers == clip.options
    again.reject()


def test_pictures_say_what_they_show():
    clip = MemoryClip()
    masks = check_picture(clip, 0, "masks")
    assert [words for words, _ in masks.legend] == ["left out in every frame, border: 5%", "reconstructed: 95%"]
    assert masks.overlay[0, 0, 3] > 0
    assert masks.overlay[20, 20, 3] == 0
    depth = check_picture(clip, 0, "depth")
    assert [words for words, _ in depth.legend] == ["near 1.8 scene units", "far 2 scene units"]
    assert tuple(depth.rgb[15, 10]) != tuple(depth.rgb[30, 40])
    labels = check_picture(clip, 0, "labels")
    assert [words.split(":")[0] for words, _ in labels.legend] == ["liver", "gallbladder"]
    assert check_picture(MemoryClip(labels=False), 0, "labels").legend[0][0] == "this frame is not annotated"
