"""Phantoms whose cameras are known, told apart by what moves."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.data.synthetic.cautery import Cautery


@pytest.fixture(scope="session")
def moving(tmp_path_factory) -> Path:
    """Camera on a path of 8 mm, tissue that breathes and is pulled, tools."""
    return _made(tmp_path_factory.mktemp("moving") / "clip", 20, 160, 128, 8.0)


@pytest.fixture(scope="session")
def rigid(tmp_path_factory) -> Path:
    """The same camera in front of tissue that neither breathes nor is pulled; tools work and tissue chars."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Cautery, "displacements", lambda self, s: [np.zeros_like(self.anatomy.rest)])
        return _made(tmp_path_factory.mktemp("rigid") / "clip", 20, 160, 128, 8.0)


@pytest.fixture(scope="session")
def still(tmp_path_factory) -> Path:
    """A camera that stands still before tissue that breathes and is pulled; large enough for breathing to be seen."""
    return _made(tmp_path_factory.mktemp("still") / "clip", 12, 320, 256, 0.0)


def _made(folder: Path, frames: int, width: int, height: int, camera_motion: float) -> Path:
    make_phantom(folder, PhantomOptions(frames, width, height, camera_motion=camera_motion))
    return folder


@pytest.fixture
def without_poses(tmp_path):
    """A clip without its poses and, at will, without its depth: the same pictures beside a camera.json of intrinsics only."""

    def strip(folder: Path, depth: bool = True) -> Path:
        out = shutil.copytree(folder, tmp_path / "stripped", ignore=shutil.ignore_patterns("gt.npz", *([] if depth else ["depth"])))
        camera = json.loads((folder / "camera.json").read_text())
        del camera["viewmats"]
        (out / "camera.json").write_text(json.dumps(camera))
        return out

    return strip
