"""File ▸ Share…"""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from degense.app.features.anonymise.file_dialog import FileDialog


@pytest.fixture
def dialog(opened, qtbot):
    opened.registry.run("file.share")
    dialog = opened.findChild(FileDialog)
    dialog.activateWindow()
    qtbot.waitUntil(dialog.isActiveWindow)
    return dialog


def test_the_scene_is_shared_with_the_prompts_that_are_shown(opened, dialog, idle, tmp_path, screenshot):
    out = tmp_path / "scene.html"
    assert dialog.path.line.text() == str(opened.session.scene.run.path.parent / "copy.html")
    screenshot(dialog, "share")
    dialog.path.line.selectAll()
    QTest.keyClicks(dialog.path.line, str(out))
    QTest.keyClick(dialog.windowHandle(), Qt.Key.Key_Return)
    idle()
    assert opened.statusBar().currentMessage().startswith(f"{out}: ")
    assert out.stat().st_size > 10_000


def test_another_suffix_is_refused_in_the_dialog(dialog, tmp_path):
    dialog.path.line.setText(str(tmp_path / "scene.pdf"))
    QTest.mouseClick(dialog.start, Qt.MouseButton.LeftButton)
    assert "must end in .html" in dialog.complaint.text()
    assert dialog.isVisible()
