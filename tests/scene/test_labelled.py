"""What no labelled frame shows has no name: outside of its view, hidden in it, or not there yet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from degense.engine.data.readers import open_clip, with_labels
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import decode_frame, decode_splats
from degense.engine.scene.labelled import LabelledPlaces
from degense.engine.semantics.prompts import PromptSet
from degense.engine.training import TrainConfig, train

FRAMES = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("labelled")
    make_phantom(folder / "clip", PhantomOptions(frames=FRAMES, width=64, height=48))
    first = folder / "first"
    (first / "labels").mkdir(parents=True)
    for name in ("classes.json", "labels/000000.png"):
        (first / name).write_bytes((folder / "clip" / name).read_bytes())
    return folder


def taught(folder, out, labels):
    clip = open_clip(folder / "clip")
    config = TrainConfig.preset_of("quick", iterations=40, semantic_steps=20, max_gaussians=900, device="cpu")
    given = with_labels(clip, labels) if labels else clip
    train(given, out, config, teacher="labels", events=lambda event: None, stop=lambda: False)
    return Scene.open(out, device="cpu", clip=clip)


@pytest.fixture(scope="module")
def scene(folder):
    return taught(folder, folder / "run", folder / "first")


def test_a_teacher_of_one_frame_leaves_what_it_shows(scene):
    support, frames = scene.run.load_label_support(len(scene.model))
    assert frames == [0]
    assert scene.renderer.labelled is not None
    assert float(support.max()) > 0.9
    assert scene.renderer.known(0, scene.camera(0)).float().mean() > 0.95


def test_a_teacher_of_the_whole_clip_leaves_nothing(folder):
    scene = taught(folder, folder / "whole", None)
    assert scene.run.load_label_support(len(scene.model)) is None
    assert scene.renderer.labelled is None


def moved(camera, by):
    """The camera, moved sideways so that the scene shifts by a share of the picture."""
    viewmat = camera.viewmat.copy()
    viewmat[0, 3] += by
    return replace(camera, viewmat=viewmat)


def test_tissue_outside_of_the_labelled_view_is_in_no_mask(scene):
    """The first frame drawn from a camera that looks past its border: what it adds is unknown, the rest is not."""
    depth = float(np.nanmedian(scene.render(0, None, ("depth",))["depth"]))
    camera = moved(scene.camera(0), -0.25 * scene.clip_size[0] / scene.camera(0).fx * depth)
    known = scene.renderer.known(0, camera).numpy()
    assert known[:, :40].mean() > 0.9
    assert known[:, 56:].mean() < 0.1
    found = decode_frame(scene, PromptSet(scene.classes), 0, camera)
    assert not found.masks[:, ~known].any()
    assert (found.labels[~known] == 255).all()
    query = scene.query(0, camera)
    assert not query.chances(scene.vectors(scene.classes)[:1])[~known].any()


def test_gaussians_that_no_labelled_frame_shows_are_in_no_mask(scene):
    """All tissue keeps its name in 3D, and loses it where the support is taken away."""
    kept = scene.renderer.labelled
    before = decode_splats(scene, PromptSet(scene.classes), 0).masks
    assert before.any()
    nothing = torch.zeros(len(scene.model))
    scene.renderer.labelled = LabelledPlaces(scene.states, nothing, [0], scene.cameras)
    try:
        assert not decode_splats(scene, PromptSet(scene.classes), 0).masks.any()
    finally:
        scene.renderer.labelled = kept
    assert not before[:, ~kept.splats().numpy()].any()
