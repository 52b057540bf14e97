"""Task: open a clip whose cameras another program has found, and begin a training with them."""

from __future__ import annotations

import numpy as np
import pytest

from degense.app.features.clip_check.check_dialog import CheckDialog
from degense.engine.clip import Clip
from tests.app import installed as on
from tests.data.readers.cameras.test_posed import COUNT, write_colmap, write_nerfstudio


@pytest.fixture
def poses() -> np.ndarray:
    """World-to-camera matrices [5, 4, 4] of a camera that goes by."""
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    matrices[:, 0, 3], matrices[:, 2, 3] = np.linspace(-2, 2, COUNT), 30.0
    return matrices


@pytest.mark.parametrize("form", ["nerfstudio", "colmap"])
def test_open_a_clip_with_cameras_of_its_own(qtbot, window, tmp_path, poses, idle, screenshot, form):
    rng = np.random.default_rng(5)
    if form == "nerfstudio":
        write_nerfstudio(tmp_path / "clip", rng, poses)
    else:
        write_colmap(tmp_path / "clip", rng, poses, rng.uniform(-5, 5, (40, 3)), binary=False)
    on.documents(window).open_path(tmp_path / "clip")
    qtbot.waitUntil(lambda: window.session.clip is not None or window.findChild(CheckDialog) is not None)
    if (dialog := window.findChild(CheckDialog)) is not None:
        screenshot(dialog, f"open-posed-{form}-check")
        dialog.accept()
    idle()
    clip = window.session.clip
    assert isinstance(clip, Clip)
    assert len(clip) == COUNT
    passed = np.stack([camera.viewmat for camera in clip.cameras])[:, 0, 3]  # in units of its own, from the first camera on
    assert np.allclose((passed - passed[0]) / (passed[-1] - passed[0]), np.linspace(0, 1, COUNT), atol=1e-5)
    assert window.menus.actions["train.start"].isEnabled()
    assert np.array_equal(on.viewer(window).panel.grab_image(), clip.frame(0))
    screenshot(window, f"open-posed-{form}")
