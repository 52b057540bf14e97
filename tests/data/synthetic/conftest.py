"""Small phantoms, made once for all tests here."""

import pytest

from degense.engine.data.synthetic import PhantomOptions, make_phantom


@pytest.fixture(scope="session")
def still(tmp_path_factory):
    """A phantom seen by a camera that stands still."""
    out = tmp_path_factory.mktemp("phantom") / "still"
    make_phantom(out, PhantomOptions(frames=11, width=160, height=128, seed=5, noise=0.0))
    return out


@pytest.fixture(scope="session")
def moving(tmp_path_factory):
    """A phantom seen by a camera that moves, with sensor noise."""
    out = tmp_path_factory.mktemp("phantom") / "moving"
    make_phantom(out, PhantomOptions(frames=7, width=160, height=128, seed=6, camera_motion=12.0))
    return out
