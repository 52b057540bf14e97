"""A coarse teacher's patches, upsampled with the frame as guide; and the basis of noisy targets."""

import numpy as np
import torch

from degense.engine.research.degraded_teachers import Degradation, DegradedTeacher
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.basis import fit_basis
from degense.engine.semantics.teachers import LabelTeacher
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.semantic.guided_upsampling import BLUR, RADIUS, RIDGE, upsample_to_regions
from degense.engine.training.semantic.targets import SemanticTargets
from tests.fakes import MemoryClip

CPU = torch.device("cpu")


def test_regions_read_a_line_through_the_patches_at_their_colour():
    """Against a weighted ridge regression of each region alone."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (24, 32, 3)).astype(np.uint8)
    index = (np.arange(24)[:, None] // 8 * 4 + np.arange(32)[None] // 8).astype(np.int32)
    index[:3] = -1
    regions = (np.arange(24)[:, None] // 4 * 8 + np.arange(32)[None] // 4).astype(np.int32)
    vectors = rng.normal(size=(12, 6)).astype(np.float32)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    found = upsample_to_regions(vectors, index, image, regions)
    import cv2

    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    side = float(np.sqrt((index >= 0).sum() / 12))
    soft = cv2.GaussianBlur(lab, (0, 0), BLUR * side).astype(np.float64)
    y, x = np.mgrid[:24, :32].astype(float)
    centres = np.array([[x[index == p].mean(), y[index == p].mean()] for p in range(12)])
    colours = np.array([soft[index == p].mean(0) for p in range(12)])
    for region in range(48):
        r = regions == region
        far = ((np.array([x[r].mean(), y[r].mean()]) - centres) ** 2).sum(1) / (RADIUS * side) ** 2
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
    teacher = DegradedTeacher(clip, EmbeddedEncoder(), Degradation("features", strength=3))
    overlap = {}
    for guided in (True, False):
        targets = SemanticTargets(teacher, frames, guided=guided)
        assert targets.frames == clip.train_frames
        vectors = torch.from_numpy(targets.basis.project(exact.vectors))
        shared = union = 0
        for frame in targets.frames:
            target = targets.target(frame)
            known = target.index >= 0
            said = (target.latents @ vectors.T).argmax(1)[target.index[known]].numpy() == 1
            truth = clip.labels(frame).ravel()[known.numpy()] == 1
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
