"""A tiny real run, and the same without its semantics or without its clip."""

import shutil

import pytest

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train


@pytest.fixture(scope="session")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiny") / "clip"
    make_phantom(folder, PhantomOptions(frames=9, width=64, height=48, seed=4))
    return open_clip(folder)


def trained(clip, out, **options):
    config = TrainConfig.preset_of("quick", iterations=80, max_gaussians=900, resolution=8, channels=8, device="cpu")
    train(clip, out, config, events=lambda event: None, stop=lambda: False, **options)
    return Scene.open(out, device="cpu")


@pytest.fixture(scope="session")
def scene(clip):
    return trained(clip, clip.path.parent / "run")


@pytest.fixture(scope="session")
def speechless(clip):
    """Trained without a teacher."""
    return trained(clip, clip.path.parent / "speechless", teacher="none")


@pytest.fixture(scope="session")
def unobserved(scene):
    """The run as an older version left it."""
    folder = scene.run.path.parent / "older"
    shutil.copytree(scene.run.path, folder)
    (folder / "observability.safetensors").unlink()
    return Scene.open(folder, device="cpu")


@pytest.fixture(scope="session")
def lonely(scene):
    """The run, when its clip is gone."""
    return Scene(scene.run, scene.model, scene.basis, scene.encoder, None, "the clip was deleted", scene.observability)
