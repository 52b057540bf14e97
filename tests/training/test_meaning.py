"""Meaning for a finished geometry: guided targets, the lift, and that nothing else is touched."""

import numpy as np
import pytest
import torch

from engine.field import FieldConfig, SceneModel
from engine.language import EmbeddedEncoder
from engine.language.basis import fit_basis
from engine.language.teachers import Degradation, DegradedTeacher, LabelTeacher
from engine.raster import rasterize
from engine.training.config import TrainConfig
from engine.training.frames import TrainingFrames
from engine.training.guided import FIELD, REACH, RIDGE, refined_by_regions
from engine.training.initialise import initial_gaussians
from engine.training.meaning import fit_meaning, lift
from engine.training.semantics import SemanticTargets
from tests.fakes import MemoryClip

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def stage():
    clip = MemoryClip()
    frames = TrainingFrames(clip, 1 << 20, CPU)
    targets = SemanticTargets(LabelTeacher(clip, EmbeddedEncoder()), frames)
    return frames, targets


def model_for(frames, targets):
    torch.manual_seed(0)
    canonical, bounds = initial_gaussians(frames, None, 400, targets.basis.rank, np.random.default_rng(0))
    return SceneModel(FieldConfig(rank=targets.basis.rank, resolution=16, time_resolution=4), bounds, canonical)


def test_the_lift_is_the_weighted_mean_of_what_is_said(stage):
    """Against blending weights found by drawing every Gaussian alone, as one feature channel each."""
    frames, targets = stage
    model = model_for(frames, targets)
    total = torch.zeros(len(model), targets.basis.rank, dtype=torch.float64)
    for frame in targets.frames:
        with torch.no_grad():
            s = model.at(frames.clip.time(frame), semantics=False).splats
            shares = rasterize(s.means, s.quats, s.scales, s.opacities, torch.eye(len(model)), frames.cameras[frame]).image
        shares = shares.reshape(-1, len(model))[targets.target(frame).pixels].double()
        total += shares.T @ (targets.target(frame).latents[targets.target(frame).index] * targets.target(frame).weight[:, None]).double()
    found = lift(model, targets, frames)
    np.testing.assert_allclose(found, torch.nn.functional.normalize(total, dim=1), atol=2e-3)


def test_only_meaning_changes_and_it_gets_better(stage):
    frames, targets = stage
    model = model_for(frames, targets)
    before = {name: value.clone() for name, value in model.state_dict().items()}
    config = TrainConfig.preset_of("quick", semantic_steps=12, region=0.0)

    def loss():
        with torch.no_grad():
            found = 0.0
            for frame in targets.frames:
                s = model.at(frames.clip.time(frame)).splats
                latent = rasterize(s.means, s.quats, s.scales, s.opacities, s.semantics, frames.cameras[frame]).image
                found += float(targets.loss(latent, frame, use_angles=True, region_weight=0.0)) / len(targets.frames)
            return found

    told = []
    assert fit_meaning(model, targets, frames, config, progress=lambda fraction, words: told.append(fraction))
    assert told == sorted(told)
    changed = {name for name, value in model.state_dict().items() if not torch.equal(value, before[name])}
    assert changed
    assert all(name.startswith(("semantic", "canonical.semantics")) for name in changed)
    assert all(parameter.requires_grad for parameter in model.parameters())
    assert loss() < 0.25
    again = model_for(frames, targets)
    fit_meaning(again, targets, frames, config)
    assert all(torch.equal(a, b) for a, b in zip(model.state_dict().values(), again.state_dict().values(), strict=True))
    assert not fit_meaning(again, targets, frames, config, stop=lambda: True)


def test_regions_read_a_line_through_the_patches_at_their_colour():
    """Against a weighted ridge regression of each region alone."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (24, 32, 3)).astype(np.uint8)
    index = (np.arange(24)[:, None] // 8 * 4 + np.arange(32)[None] // 8).astype(np.int32)
    index[:3] = -1
    regions = (np.arange(24)[:, None] // 4 * 8 + np.arange(32)[None] // 4).astype(np.int32)
    vectors = rng.normal(size=(12, 6)).astype(np.float32)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    found = refined_by_regions(vectors, index, image, regions)
    import cv2

    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    side = float(np.sqrt((index >= 0).sum() / 12))
    soft = cv2.GaussianBlur(lab, (0, 0), FIELD * side).astype(np.float64)
    y, x = np.mgrid[:24, :32].astype(float)
    centres = np.array([[x[index == p].mean(), y[index == p].mean()] for p in range(12)])
    colours = np.array([soft[index == p].mean(0) for p in range(12)])
    for region in range(48):
        r = regions == region
        far = ((np.array([x[r].mean(), y[r].mean()]) - centres) ** 2).sum(1) / (REACH * side) ** 2
        w = np.exp(-0.5 * far) * [(index == p).sum() for p in range(12)]
        w /= w.sum()
        c = colours - w @ colours
        v = vectors - w @ vectors
        line = np.linalg.solve((c.T * w) @ c + RIDGE * np.eye(3), (c.T * w) @ v)
        mixed = w @ vectors + (lab[r].mean(0) - w @ colours) @ line
        np.testing.assert_allclose(found[region], mixed / np.linalg.norm(mixed), atol=2e-3)


class Strip(MemoryClip):
    """A grey strip, 6 pixels wide, on a red wall."""

    strip = slice(37, 43)

    def frame(self, index):
        image = np.random.default_rng(index).normal((150, 60, 50), 4, (80, 96, 3))
        image[:, self.strip] += np.array([10, 90, 110])
        return np.clip(image, 0, 255).astype(np.uint8)

    def labels(self, index):
        labels = np.zeros((80, 96), np.uint8)
        labels[:, self.strip] = 1
        return labels

    def valid(self, index):
        return np.ones((80, 96), bool)


def test_a_coarse_teacher_finds_a_thin_strip_with_the_pictures_help():
    clip = Strip(10, 96, 80)
    frames = TrainingFrames(clip, 1 << 20, CPU)
    exact = LabelTeacher(clip, EmbeddedEncoder())
    teacher = DegradedTeacher(exact, Degradation(patches=12, noise=0.2))
    overlap = {}
    for guided in (True, False):
        targets = SemanticTargets(teacher, frames, guided=guided)
        assert targets.frames == clip.train_frames
        vectors = torch.from_numpy(targets.basis.project(exact.vectors))
        shared = union = 0
        for frame in targets.frames:
            target = targets.target(frame)
            said = (target.latents @ vectors.T).argmax(1)[target.index].numpy() == 1
            truth = clip.labels(frame).ravel()[target.pixels.numpy()] == 1
            shared, union = shared + (said & truth).sum(), union + (said | truth).sum()
        overlap[guided] = shared / union
    assert overlap[True] > overlap[False] + 0.1, overlap


def test_noise_does_not_fill_the_basis_but_what_is_asked_for_stays():
    rng = np.random.default_rng(1)
    classes = EmbeddedEncoder().encode(["liver", "fat", "gallbladder", "grasper"])
    said = classes[rng.choice(4, 4000, p=[0.5, 0.3, 0.199, 0.001])]
    noisy = said + 0.05 * rng.normal(size=said.shape)
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    assert fit_basis(noisy, np.ones(4000)).rank == 32
    basis = fit_basis(noisy, np.ones(4000), anchors=classes[:3])
    assert 3 <= basis.rank <= 5
    assert np.linalg.norm(basis.project(classes[:3]), axis=1).min() > 0.95
    exact = fit_basis(said, np.ones(4000), anchors=classes)
    assert exact.rank == fit_basis(said, np.ones(4000)).rank
