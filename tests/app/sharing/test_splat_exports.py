"""Task: take the Gaussians of a frame to another program, from the menu of the window."""

from __future__ import annotations

import numpy as np
import pygltflib
import pytest
from PySide6.QtWidgets import QFileDialog

from tests.app.tasks.hands import Mouse
from tests.fakes import ply_columns
from tests.store.test_splat_files import read_spz

FLIPPED = np.array([1.0, -1.0, -1.0])  # from x right, y down, z forward to x right, y up, z back


def gltf_means(path) -> np.ndarray:
    document = pygltflib.GLTF2().load_binary(str(path))
    assert document.extensionsUsed == ["KHR_gaussian_splatting"]
    accessor = document.accessors[document.meshes[0].primitives[0].attributes.POSITION]
    view = document.bufferViews[accessor.bufferView]
    data = document.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    return np.frombuffer(data, "<f4").reshape(accessor.count, 3) * FLIPPED


@pytest.mark.parametrize(
    ("title", "suffix", "means"),
    [
        ("Gaussians of one frame (PLY)", ".ply", lambda path: ply_columns(path)[:, :3]),
        ("Gaussians of one frame, compressed (SPZ)", ".spz", lambda path: read_spz(path.read_bytes()).means.numpy() * FLIPPED),
        ("Gaussians of one frame (glTF)", ".glb", gltf_means),
    ],
)
def test_a_frame_is_saved_from_the_menu(qtbot, opened, idle, tmp_path, monkeypatch, title, suffix, means):
    opened.session.go_to(4)
    idle()
    proposed: list[str] = []

    def answer(parent, asking: str, proposal: str, kinds: str):
        proposed.append(proposal)
        return str(tmp_path / f"mine{suffix}"), kinds

    monkeypatch.setattr(QFileDialog, "getSaveFileName", answer)
    Mouse(opened, idle, qtbot.waitUntil).choose("File", "Export", title)
    idle()
    expected = opened.session.scene.splats(4)
    assert proposed[0].endswith(suffix)
    assert np.allclose(means(tmp_path / f"mine{suffix}"), expected.means.numpy(), atol=0.51 / 2048)
    assert opened.statusBar().currentMessage() == f"{tmp_path / f'mine{suffix}'}: {len(expected)} Gaussians at frame 4"
