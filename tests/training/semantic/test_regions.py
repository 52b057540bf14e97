"""Regions around a place: votes against a sum over all pairs, and what they give where a teacher errs for long."""

import cv2
import numpy as np
import pytest
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.raster import rasterize
from degense.engine.semantics.masks.superpixels import superpixels
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from degense.engine.training.semantic.finished import FinishedGeometry
from degense.engine.training.semantic.regions import COLOR_SCALE, Regions
from tests.fakes import MemoryClip

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def stage():
    frames = TrainingFrames(MemoryClip(5, 96, 80), 1 << 20, CPU)
    torch.manual_seed(0)
    canonical, bounds = initial_gaussians(frames, None, 200, 0, np.random.default_rng(0), 2)
    return frames, SceneModel(FieldConfig(color_knots=2, resolution=16, time_resolution=4), bounds, canonical)


def traits_of(frames, model, frame):
    """Superpixel of each pixel, and the traits of the superpixels, in plain NumPy."""
    image = frames.image(frame)
    of_pixel = superpixels(image).ravel()
    with torch.no_grad():
        splats = model.at(frames.clip.time(frame), semantics=False).splats
        weights = rasterize(splats, torch.eye(len(model)), frames.cameras[frame]).image.reshape(-1, len(model)).double().numpy()
    places = weights @ model.canonical["means"].detach().double().numpy() / np.maximum(weights.sum(1), 1e-3)[:, None]
    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB).reshape(-1, 3)
    width = frames.size[0] / frames.cameras[0].fx
    traits = np.concatenate([places / (0.15 * width), lab / COLOR_SCALE], 1)
    return of_pixel, np.stack([traits[of_pixel == k].mean(0) for k in range(of_pixel.max() + 1)])


def test_votes_are_weighed_by_place_in_the_scene_and_colour(stage):
    frames, model = stage
    regions, random = Regions(FinishedGeometry(model, frames)), np.random.default_rng(1)
    of_pixel, traits, sums = {}, {}, {}
    for frame in (0, 2, 3):
        of_pixel[frame], traits[frame] = traits_of(frames, model, frame)
        shares = random.dirichlet(np.ones(3), len(of_pixel[frame]))
        shares[:1000] = 0  # nothing is said here
        sums[frame] = np.stack([shares[of_pixel[frame] == k].sum(0) for k in range(len(traits[frame]))])
        if frame != 3:
            regions.add(frame, regions.sums(frame, torch.from_numpy(shares).float()))
    far = ((traits[3][:, None] - np.concatenate([traits[0], traits[2]])[None]) ** 2).sum(-1)
    expected = np.exp(-far / 2) @ np.concatenate([sums[0], sums[2]])
    expected = (expected / expected.sum(1, keepdims=True))[of_pixel[3]]
    np.testing.assert_allclose(regions.read(3, 0.15), expected, atol=2e-3)
    regions.clear()
    regions.add(2, regions.sums(2, torch.eye(3)[torch.zeros(96 * 80, dtype=torch.int64)]))
    assert (regions.read(3, 0.15)[:, 0] > 0.999).all()


class TwoColors(MemoryClip):
    """Red on the left, yellow on the right."""

    def frame(self, index):
        image = np.repeat(np.uint8([[150, 40, 40], [220, 190, 90]]), 48, 0)[None].repeat(80, 0)
        return image + np.random.default_rng(index).integers(0, 8, image.shape, np.uint8)


def test_a_region_that_is_called_otherwise_for_most_of_the_clip_is_called_as_what_looks_like_it():
    frames = TrainingFrames(TwoColors(5, 96, 80), 1 << 20, CPU)
    canonical, bounds = initial_gaussians(frames, None, 200, 0, np.random.default_rng(0), 2)
    model = SceneModel(FieldConfig(color_knots=2, resolution=16, time_resolution=4), bounds, canonical)
    regions = Regions(FinishedGeometry(model, frames))
    truth = np.repeat([0, 1], 48)[None].repeat(80, 0)
    for frame in (0, 2, 3, 4):
        names = truth.copy()
        names[30:44, 20:34] = frame > 0
        regions.add(frame, regions.sums(frame, torch.eye(2)[torch.from_numpy(names.ravel())]))
    said = regions.read(0, 0.15).argmax(1).reshape(80, 96).numpy()
    assert (said == truth).mean() > 0.97
    assert (said[30:44, 20:34] == 0).all()
