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
    support = scene.run.load_label_support(len(scene.model))
    assert support.frames == [0]
    assert scene.renderer.labelled is not None
    assert float(support.shown.max()) > 0.9
    assert float(support.familiar.max()) > 0.9
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


@pytest.fixture
def told(scene):
    """Lets the scene have another support, and its own again afterwards."""
    kept, support = scene.renderer.labelled, scene.run.load_label_support(len(scene.model))

    def tell(**changed):
        scene.renderer.labelled = LabelledPlaces(scene.states, support._replace(**changed), scene.cameras)
        scene.renderer.forget()

    yield tell
    scene.renderer.labelled = kept
    scene.renderer.forget()


def past_the_border(scene):
    """The camera of the first frame, looking past its border."""
    depth = float(np.nanmedian(scene.render(0, None, ("depth",))["depth"]))
    return moved(scene.camera(0), -0.25 * scene.clip_size[0] / scene.camera(0).fx * depth)


def test_unfamiliar_tissue_outside_of_the_labelled_view_is_in_no_mask(scene, told):
    """What the moved camera adds is unknown, the rest is not."""
    told(familiar=torch.zeros(len(scene.model)))
    camera = past_the_border(scene)
    known = scene.renderer.known(0, camera).numpy()
    assert known[:, :40].mean() > 0.9
    assert known[:, 56:].mean() < 0.1
    found = decode_frame(scene, PromptSet(scene.classes), 0, camera)
    assert not found.masks[:, ~known].any()
    assert (found.labels[~known] == 255).all()
    query = scene.query(0, camera)
    assert not query.chances(scene.vectors(scene.classes)[:1])[~known].any()


def test_familiar_tissue_keeps_its_name_though_no_labelled_frame_shows_it(scene, told):
    """The left half of what is drawn is shown by no labelled frame; it has names where it looks like what is."""
    places, _ = scene.camera(0).project(scene.states.advected_means(0).numpy())
    left = torch.from_numpy(places[:, 0] < scene.clip_size[0] / 2).float()
    told(shown=1 - left, familiar=torch.zeros_like(left))
    known, half = scene.renderer.known(0, scene.camera(0)).numpy(), scene.clip_size[0] // 2
    assert known[:, : half - 8].mean() < 0.1 < 0.9 < known[:, half + 8 :].mean()
    told(shown=1 - left, familiar=left)
    assert scene.renderer.known(0, scene.camera(0)).float().mean() > 0.95


def test_gaussians_that_no_labelled_frame_shows_are_in_no_mask(scene, told):
    """All tissue keeps its name in 3D, and loses it where the support is taken away."""
    kept = scene.renderer.labelled.splats().numpy()
    before = decode_splats(scene, PromptSet(scene.classes), 0).masks
    assert before.any()
    assert not before[:, ~kept].any()
    nothing = torch.zeros(len(scene.model))
    told(shown=nothing, familiar=nothing)
    assert not decode_splats(scene, PromptSet(scene.classes), 0).masks.any()
