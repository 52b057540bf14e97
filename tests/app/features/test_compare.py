"""Task: hold the reconstruction against the recording."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt

from tests.app import installed as on


def test_cycle_through_wipe_blink_and_difference(qtbot, opened, idle, screenshot):
    session, panel = opened.session, on.viewer(opened).panel
    session.go_to(4)
    panel.setFocus()
    recorded, drawn = session.scene.observed(4), session.scene.render_rgb(4)
    qtbot.keyClick(panel, Qt.Key.Key_C)
    idle()
    assert panel.comparison.mode == session.view_state.compare == "wipe"
    assert np.array_equal(on.viewer(opened).view.observed, recorded)
    shown = panel.grab_image()
    assert np.array_equal(shown[:, :10], drawn[:, :10])
    assert np.array_equal(shown[:, -10:], recorded[:, -10:])
    screenshot(opened, "compare-wipe")
    qtbot.keyClick(panel, Qt.Key.Key_C)
    idle()
    assert panel.comparison.mode == "blink"
    qtbot.waitUntil(lambda: np.array_equal(panel.grab_image(), recorded))
    qtbot.waitUntil(lambda: np.array_equal(panel.grab_image(), drawn))
    qtbot.keyClick(panel, Qt.Key.Key_C)
    idle()
    assert panel.comparison.mode == "difference"
    screenshot(opened, "compare-difference")
    session.go_to(6)
    idle()
    assert np.array_equal(on.viewer(opened).view.observed, session.scene.observed(6))
    qtbot.keyClick(panel, Qt.Key.Key_C)
    idle()
    assert panel.comparison.mode == "off"
    assert on.viewer(opened).view.observed is None
    assert np.array_equal(panel.grab_image(), session.scene.render_rgb(6))
