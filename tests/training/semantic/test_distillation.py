"""Distillation onto a finished geometry: guided targets, feature back-projection, and that nothing else is touched."""

import numpy as np
import pytest
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.raster import rasterize
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.teachers import LabelTeacher
from degense.engine.training.config import TrainConfig
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from degense.engine.training.losses import angular
from degense.engine.training.semantic.distillation import COLOR_RIDGE, backproject_features, distill
from degense.engine.training.semantic.finished import FinishedGeometry
from degense.engine.training.semantic.targets import SemanticTargets
from tests.fakes import MemoryClip

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def stage():
    clip = MemoryClip()
    frames = TrainingFrames(clip, 1 << 20, CPU)
    targets = SemanticTargets(LabelTeacher(clip, EmbeddedEncoder()), frames)
    return frames, targets


def model_for(frames, targets, color_knots=0):
    torch.manual_seed(0)
    canonical, bounds = initial_gaussians(frames, None, 400, targets.basis.rank, np.random.default_rng(0), color_knots)
    return SceneModel(FieldConfig(rank=targets.basis.rank, color_knots=color_knots, resolution=16, time_resolution=4), bounds, canonical)


def labels_seen(model, targets, frames, frame):
    """What is said of each Gaussian in a frame, its share [N] and its colour, from blending weights found by drawing each as a channel."""
    with torch.no_grad():
        s = model.at(frames.clip.time(frame), semantics=False).splats
        shares = rasterize(s, torch.eye(len(model)), frames.cameras[frame]).image
    target = targets.target(frame)
    known = target.index >= 0
    shares = shares.reshape(-1, len(model))[known].double() * target.weight[known, None].double()
    return shares.T @ target.latents[target.index[known]].double(), shares.sum(0), s.colors.double()


def test_where_nothing_changes_colour_back_projection_is_the_weighted_mean_of_the_labels(stage):
    frames, targets = stage
    model = model_for(frames, targets)
    total = sum(labels_seen(model, targets, frames, frame)[0] for frame in targets.frames)
    latents, semantic_coefficients = backproject_features(FinishedGeometry(model, frames), targets)
    np.testing.assert_allclose(latents, torch.nn.functional.normalize(total, dim=1), atol=2e-3)
    assert not semantic_coefficients.any()


def test_where_colours_change_back_projection_is_a_ridge_regression_on_them(stage):
    """Against a weighted regression of each Gaussian alone, in float64."""
    frames, targets = stage
    model = model_for(frames, targets, color_knots=4)
    with torch.no_grad():
        model.canonical["color_residuals"].copy_(
            0.2 * torch.randn(model.canonical["color_residuals"].shape, generator=torch.Generator().manual_seed(1))
        )
    said, share, colour = (
        torch.stack(parts) for parts in zip(*(labels_seen(model, targets, frames, i) for i in targets.frames), strict=True)
    )
    latents, semantic_coefficients = backproject_features(FinishedGeometry(model, frames), targets)
    canonical = model.canonical["colors"].detach().double()
    checked = 0
    for i in range(0, len(model), 7):
        w = share[:, i] / share[:, i].sum()
        if share[:, i].sum() < 1e-3:
            continue
        c = colour[:, i] - canonical[i]
        words = said[:, i].sum(0) / share[:, i].sum()
        centred = c - w @ c
        slope = torch.linalg.solve(
            (centred.T * w) @ centred + COLOR_RIDGE * torch.eye(3, dtype=torch.float64), centred.T @ said[:, i] / share[:, i].sum()
        )
        np.testing.assert_allclose(semantic_coefficients[i], slope / words.norm(), atol=5e-3)
        np.testing.assert_allclose(latents[i], (words - (w @ c) @ slope) / words.norm(), atol=5e-3)
        checked += 1
    assert checked > 20


class Charring(MemoryClip):
    """A square that stays in its place, turns dark in the middle of the clip and is called by another name from then on."""

    def place(self, index):
        return slice(12, 24), slice(16, 28)

    def frame(self, index):
        image = self.wall.copy()
        image[self.place(index)] = (30, 20, 20) if self.charred(index) else (220, 140, 130)
        return image

    def labels(self, index):
        labels = np.zeros(self.wall.shape[:2], np.uint8)
        labels[self.place(index)] = self.charred(index)
        return labels

    def charred(self, index):
        return index >= 5


def test_what_changes_its_look_changes_its_name():
    clip = Charring()
    frames = TrainingFrames(clip, 1 << 20, CPU)
    teacher = LabelTeacher(clip, EmbeddedEncoder())
    targets = SemanticTargets(teacher, frames)
    model = model_for(frames, targets, color_knots=10)
    wanted = torch.tensor([30.0, 20, 20]) / 255 - torch.tensor([220.0, 140, 130]) / 255
    with torch.no_grad():
        model.canonical["temporal_windows"].zero_()  # nothing comes or goes: it changes its colour
        x, y = frames.cameras[0].project(model.canonical["means"].double().numpy())[0].T
        inside = torch.from_numpy((x > 16) & (x < 28) & (y > 12) & (y < 24))
        model.canonical["color_residuals"][inside, 5:] = wanted
    latents, semantic_coefficients = backproject_features(FinishedGeometry(model, frames), targets)
    model.canonical["semantics"].data.copy_(latents)
    model.set_semantic_coefficients(semantic_coefficients)
    vectors = torch.from_numpy(targets.basis.project(teacher.vectors)).float()
    for frame in (1, 9):  # both held out
        with torch.no_grad():
            s = model.at(clip.time(frame)).splats
        found = rasterize(s, s.semantics, clip.cameras[frame]).image[14:22, 18:26] @ vectors.T
        assert (found.argmax(-1) == int(clip.charred(frame))).all(), frame


def test_only_semantics_change_and_it_gets_better(stage):
    frames, targets = stage
    model = model_for(frames, targets)
    before = {name: value.clone() for name, value in model.state_dict().items()}
    config = TrainConfig.preset_of("quick", semantic_steps=12, region=0.0)

    def loss():
        with torch.no_grad():
            found = 0.0
            for frame in targets.frames:
                s = model.at(frames.clip.time(frame)).splats
                latent = rasterize(s, s.semantics, frames.cameras[frame]).image
                found += float(targets.loss(latent, frame, angular, 0.0)["align"]) / len(targets.frames)
            return found

    told = []
    assert distill(model, targets, frames, config, progress=lambda fraction, words: told.append(fraction))
    assert told == sorted(told)
    changed = {name for name, value in model.state_dict().items() if name not in before or not torch.equal(value, before[name])}
    assert changed
    assert all(name.startswith(("semantic", "canonical.semantics", "semantic_coefficients")) for name in changed)
    assert [name for name, parameter in model.named_parameters() if not parameter.requires_grad] == ["canonical.temporal_windows"]
    assert loss() < 0.25
    again = model_for(frames, targets)
    distill(again, targets, frames, config)
    assert all(torch.equal(a, b) for a, b in zip(model.state_dict().values(), again.state_dict().values(), strict=True))
    assert not distill(again, targets, frames, config, stop=lambda: True)
    assert again.semantic_coefficients is None  # so that a training that is resumed finds the model it knows
