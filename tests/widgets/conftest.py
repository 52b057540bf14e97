"""What tests of widgets share."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtWidgets import QWidget

from degense.engine.camera import Camera


@pytest.fixture
def rng():
    return np.random.default_rng(20260)


@pytest.fixture
def show(qtbot):
    """Show a widget at a size and wait until it is on the screen; it is closed after the test."""

    def show(widget: QWidget, width: int = 400, height: int = 300) -> QWidget:
        qtbot.addWidget(widget)
        widget.resize(width, height)
        with qtbot.waitExposed(widget):
            widget.show()
        widget.activateWindow()
        return widget

    return show


@pytest.fixture
def camera(rng) -> Camera:
    """A posed camera whose principal point is off centre."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    viewmat = np.eye(4)
    viewmat[:3, :3] += np.sin(0.7) * skew + (1 - np.cos(0.7)) * skew @ skew
    viewmat[:3, 3] = rng.normal(size=3)
    return Camera(96, 72, 100.0, 90.0, 43.0, 40.0, viewmat)


@pytest.fixture
def splats(rng, camera):
    """300 Gaussians before the camera: means, quats, scales, opacities, colours."""
    n = 300
    pixels = rng.uniform([4, 4], [camera.width - 4, camera.height - 4], (n, 2))
    means = camera.unproject(pixels, rng.uniform(3, 6, n))
    scales = np.exp(rng.uniform(np.log(0.02), np.log(0.25), (n, 3)))
    return means, rng.normal(size=(n, 4)), scales, rng.uniform(0.05, 0.99, n), rng.uniform(0, 1, (n, 3))
