"""A screen with two pixels where others have one: pictures are as fine as the screen, and a click hits what one sees."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.house.source import ROOT

WINDOW = """
import json
import sys
from pathlib import Path
from PySide6.QtCore import QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from degense.app.research.event_loop import rest, wait
from degense.app.shell.settings import SettingsFile
from degense.app.application import FEATURES
from degense.app.shell.shell import Shell
from tests.app import installed as on
from degense.widgets.qt_images import to_array
from degense.widgets.theme import apply_theme
import numpy as np

run, settings, out = map(Path, sys.argv[1:4])
app = QApplication([])
apply_theme(app, "dark")
window = Shell(SettingsFile(settings), FEATURES)
window.show()
on.documents(window).open_path(run)
session = window.session
wait(lambda: on.viewer(window).splats is not None and on.viewer(window).view is not None)
rest(window)
panel, canvas = on.viewer(window).panel, on.viewer(window).splats.focusProxy()
whole = to_array(window.grab().toImage())
np.save(settings.parent / "whole.npy", whole)
panel.zoom.set_factor(3.0)  # screen pixels an image pixel: no whole number of the window's own
np.save(settings.parent / "shown.npy", to_array(panel.grab().toImage()))
np.save(settings.parent / "picture.npy", on.viewer(window).view.rgb)
corner = panel.zoom.to_widget(QPointF(0, 0))
panel.zoom.set_factor(8.0)
QTest.mouseClick(panel, Qt.MouseButton.LeftButton, pos=panel.zoom.to_widget(QPointF(30.5, 50.5)).toPoint())
rest(window)
still = on.viewer(window).splats.screenshot_image()
print(json.dumps({
    "ratio": panel.devicePixelRatioF(),
    "panel": [panel.width(), panel.height()],
    "corner": [corner.x(), corner.y()],
    "probe": [session.probe.x, session.probe.y],
    "canvas": [canvas.width(), canvas.height()],
    "still": list(still.shape),
    "window": [window.width(), window.height()],
}))
window.grab().save(str(out / "hidpi.png"))
window.close()
"""


def test_two_screen_pixels_a_pixel(run, tmp_path):
    out = Path(os.environ.get("DEGENSE_SCREENSHOTS", tmp_path))
    out.mkdir(parents=True, exist_ok=True)
    child = subprocess.run(
        [sys.executable, "-c", WINDOW, str(run), str(tmp_path / "settings.json"), str(out)],
        cwd=ROOT,
        env={**os.environ, "QT_SCALE_FACTOR": "2"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert child.returncode == 0, child.stderr
    told = json.loads(child.stdout.splitlines()[-1])
    assert told["ratio"] == 2.0
    shown, picture, whole = (np.load(tmp_path / f"{name}.npy").astype(int) for name in ("shown", "picture", "whole"))
    assert shown.shape[:2] == (2 * told["panel"][1], 2 * told["panel"][0])
    assert whole.shape[:2] == (2 * told["window"][1], 2 * told["window"][0])
    assert told["still"][:2] == [2 * told["canvas"][1], 2 * told["canvas"][0]]  # the 3D view
    assert told["probe"] == [30.5, 50.5]
    # Every pixel of the picture is three of the screen's wide: its middle has its colour, which a picture of half the size could not have.
    y, x = np.mgrid[0 : picture.shape[0], 0 : picture.shape[1]]
    across, down = (np.floor(2 * told["corner"][axis] + 3 * (index + 0.5)).astype(int) for axis, index in enumerate((x, y)))
    seen = (across >= 0) & (across < shown.shape[1]) & (down >= 0) & (down < shown.shape[0])
    assert seen.mean() > 0.5
    off = np.abs(shown[down[seen], across[seen]] - picture[seen]).max(-1)
    assert (off > 2).mean() < 0.01
