"""Task: check what was found in a clip on its pictures, and correct it before anything is written."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog

from degense.app.features.clip_check import camera_plan as clip_plan
from degense.app.features.clip_check.check_dialog import CheckDialog
from degense.app.features.clip_check.check_frames import draw_check_frame
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from tests.app import installed as on
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


def asked_again(window) -> dict:
    """What the dialog answers when it is opened once more."""
    window.registry.run("file.check")
    again = next(dialog for dialog in window.findChildren(CheckDialog) if dialog.isVisible())
    answers = again.answers
    again.reject()
    return answers


def test_check_and_correct_a_clip(qtbot, window, masked, idle, monkeypatch, screenshot):
    before = {path: path.stat().st_mtime_ns for path in masked.rglob("*")}
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *args: str(masked))
    window.registry.run("file.open-clip")
    qtbot.waitUntil(lambda: window.findChild(CheckDialog) is not None)
    dialog = window.findChild(CheckDialog)

    def settled() -> None:
        qtbot.waitUntil(lambda: dialog.use.isEnabled() and not window.worker.busy("check-frame"))

    settled()
    dialog.controls["mask_means"].setFocus(Qt.FocusReason.TabFocusReason)  # the picture follows the control
    assert dialog.aspect.currentData() == "masks"
    settled()
    left_out = window.session.clip.valid(0).mean()
    assert dialog.controls["mask_means"].currentData() is None
    screenshot(window, "check-masks")
    other = "keep" if left_out > 0.5 else "tool"
    dialog.controls["mask_means"].setCurrentIndex(dialog.controls["mask_means"].findData(other))
    assert not dialog.use.isEnabled()
    settled()
    assert dialog._clip.valid(0).mean() == pytest.approx(1 - left_out)
    pictures = []
    dialog.controls["focal"].setFocus(Qt.FocusReason.TabFocusReason)
    for focal in (dialog.controls["focal"].value(), 60.0, 123.0):
        dialog.controls["focal"].setValue(focal)
        settled()
        pictures.append(dialog.panel.grab_image())
        screenshot(window, f"check-focal-{focal:.0f}")
    assert dialog.aspect.currentData() == "focal"
    assert not np.array_equal(pictures[1], pictures[2])
    assert "123 px shows 43° across" in dialog.found["focal"].text()
    dialog.controls["poses"].setFocus(Qt.FocusReason.TabFocusReason)
    assert dialog.aspect.currentData() == "poses"
    pictures.clear()
    for poses in ("estimate", "still"):
        dialog.controls["poses"].setCurrentIndex(dialog.controls["poses"].findData(poses))
        settled()
        pictures.append(dialog.panel.grab_image())
        screenshot(window, f"check-poses-{poses}")
    assert not np.array_equal(*pictures)
    for aspect in ("depth", "labels"):
        dialog._turn_to(aspect)
        settled()
        screenshot(window, f"check-{aspect}")
    dialog.controls["layout"].setCurrentIndex(dialog.controls["layout"].findData("cholecseg8k"))
    qtbot.waitUntil(lambda: dialog.complaint.isVisible())
    assert not dialog.use.isEnabled()
    dialog.controls["layout"].setCurrentIndex(0)
    settled()
    assert {path: path.stat().st_mtime_ns for path in masked.rglob("*")} == before
    dialog.frame.setValue(3)
    settled()
    qtbot.mouseClick(dialog.use, Qt.MouseButton.LeftButton)
    idle()
    clip = window.session.clip
    assert clip.options == {"mask_means": other, "focal": 123.0, "poses": "still"}
    assert clip.cameras[0].fx == 123.0
    assert on.documents(window).clip_options == clip.options  # the training begins with them
    assert asked_again(window) == clip.options


def test_pictures_say_what_they_show():
    clip = MemoryClip()
    masks = draw_check_frame(clip, 0, "masks")
    assert [words for words, _ in masks.legend] == ["left out in every frame, border: 5%", "reconstructed: 95%"]
    assert masks.overlay[0, 0, 3] > 0
    assert masks.overlay[20, 20, 3] == 0
    depth = draw_check_frame(clip, 0, "depth")
    assert [words for words, _ in depth.legend] == ["near 1.8 scene units", "far 2 scene units"]
    assert tuple(depth.rgb[15, 10]) != tuple(depth.rgb[30, 40])
    focal = draw_check_frame(clip, 0, "focal")
    assert [words for words, _ in focal.legend] == [
        "focal length 53 px: 49° across, 41° down",
        "tissue along the middle of the frame",
        "bar: 0.5 scene units",
    ]
    labels = draw_check_frame(clip, 0, "labels")
    assert [words.split(":")[0] for words, _ in labels.legend] == ["liver", "gallbladder"]
    assert draw_check_frame(MemoryClip(labels=False), 0, "labels").legend[0][0] == "this frame is not annotated"


def test_the_plan_shows_angles_and_paths_as_they_are():
    """Seen from above the sides of the view meet at the angle of view, and a camera that goes right and turns is drawn so."""
    clip = MemoryClip()
    rgb = draw_check_frame(clip, 0, "focal").rgb.astype(int)
    side = np.abs(rgb - clip_plan.VIEW).max(-1) < 30
    spread = [np.ptp(np.flatnonzero(side[row])) for row in (300, 400, 500)]
    slopes = np.diff(spread) / 100  # how much wider a step forward makes the view
    angles = 2 * np.degrees(np.arctan(-slopes / 2))
    assert angles == pytest.approx(clip_plan.field_of_view(clip.cameras[0])[0], abs=1.5)
    assert draw_check_frame(clip, 0, "poses").legend[0][0] == "the camera stands still"
    turn = np.radians(6.0)
    for number, camera in enumerate(clip.cameras):
        viewmat = np.eye(4)
        angle = turn * number / 9
        viewmat[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
        viewmat[:3, 3] = viewmat[:3, :3] @ [-0.1 * number, 0.0, 0.0]
        clip.cameras[number] = replace(camera, viewmat=viewmat)
    path = draw_check_frame(clip, 9, "poses")
    assert path.legend[0][0] == "frame 9; the camera moves 0.9 scene units in all and turns by up to 6.0°"
    first, last = (np.abs(path.rgb.astype(int) - colour).max(-1) < 4 for _, colour in path.legend[1:3])
    assert np.flatnonzero(first.any(0)).mean() + 100 < np.flatnonzero(last.any(0)).mean()  # to the right
    clip.poses = "estimate"
    assert "not known yet" in draw_check_frame(clip, 9, "poses").legend[0][0]


def test_the_path_of_a_moving_clip_is_seen(qtbot, window, tmp_path, idle, screenshot):
    make_phantom(tmp_path / "moving", PhantomOptions(frames=12, width=96, height=80, camera_motion=1.0), lambda fraction, message: None)
    on.documents(window).open_path(tmp_path / "moving")
    idle()
    window.registry.run("file.check")
    dialog = window.findChild(CheckDialog)
    dialog.controls["poses"].setFocus(Qt.FocusReason.TabFocusReason)
    pictures = []
    for frame in (0, 6):
        dialog.frame.setValue(frame)
        idle()
        pictures.append(dialog.panel.grab_image())
    assert not np.array_equal(*pictures)
    assert "the camera moves" in dialog.panel.marks._legend[0][0]
    screenshot(window, "check-poses")
    dialog.reject()
