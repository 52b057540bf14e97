"""Losses, masks, teachers and scores on numbers that nobody wants."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError
from degense.engine.metrics.image import ImageScores
from degense.engine.metrics.masks import MaskScores
from degense.engine.metrics.motion import MotionScores
from degense.engine.research.stress.features import SpoiltTeacher, latent_kinds, loss_finding, mask_finding, teacher_kinds
from degense.engine.research.stress.outcome import sound
from degense.engine.semantics.basis import Basis
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.prompts import DECODERS, PromptVectors
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.losses import angular, inverse_depth, photometric, region_smoothness, rigidity
from degense.engine.training.semantic import targets as semantics
from degense.engine.training.semantic.targets import SemanticTargets
from tests.fakes import MemoryClip

KINDS = latent_kinds()
quickly = settings(max_examples=30)


@pytest.mark.parametrize("name", [name for name, latent in KINDS.items() if np.isfinite(latent).all()])
def test_the_angular_loss(name):
    finding = loss_finding(KINDS[name], "cpu")
    assert sound(vars(finding)), finding
    assert finding.bad == 0


@pytest.mark.parametrize("name", KINDS)
def test_masks(name):
    finding = mask_finding(KINDS[name])
    assert sound(vars(finding)), finding
    assert finding.bad == 0


@quickly
@given(
    size=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    numbers=st.lists(st.floats(width=32), min_size=1, max_size=6),
    brightness=st.integers(0, 255),
    seed=st.integers(0, 99),
    threshold=st.floats(-1, 1),
)
def test_masks_of_any_latents_and_sizes(size, numbers, brightness, seed, threshold):
    random = np.random.default_rng(seed)
    latent = random.choice(np.array(numbers, np.float32), (*size, 4))
    alpha = random.choice(np.array([0, 1, np.nan, np.inf, -1], np.float32), size)
    rgb = np.full((*size, 3), brightness, np.uint8)
    query = FrameSemantics(rgb, latent, Basis(np.eye(8, 4, dtype=np.float32), 1.0), alpha)
    vectors = random.normal(size=(3, 8)).astype(np.float32)
    for values in (query.similarity(vectors), query.refined(vectors[0])):
        assert values.shape == size
        assert np.isfinite(values).all()
    assert np.abs(query.similarity(vectors)).max() <= 1 + 1e-5
    for decoder in DECODERS:
        found = query.decode(PromptVectors(tuple(vectors), (), vectors, decoder, threshold))
        assert found.masks.shape == (3, *size)
        assert set(np.unique(found.labels)) <= {0, 1, 2, UNLABELLED}
    assert 0 <= query.confidence(vectors[0], np.ones(size, bool), vectors) <= 1


def test_a_zero_prompt_means_nothing():
    query = FrameSemantics(np.zeros((8, 9, 3), np.uint8), np.ones((8, 9, 4), np.float32), Basis(np.eye(8, 4, dtype=np.float32), 1.0))
    assert not query.similarity(np.zeros(8)).any()
    assert not query.decode(PromptVectors((np.zeros(8),))).masks.any()


@quickly
@given(image=st.floats(0, 1), target=st.floats(0, 1), valid=st.sampled_from(["all", "none", "one"]), ssim=st.sampled_from([0.0, 0.2, 1.0]))
def test_the_photometric_loss_of_constant_pictures(image, target, valid, ssim):
    weight = torch.zeros(14, 12) if valid == "none" else torch.ones(14, 12)
    if valid == "one":
        weight[1:], weight[0, 1:] = 0, 0
    drawn = torch.full((14, 12, 3), image, requires_grad=True)
    loss = sum(photometric(drawn, torch.full((14, 12, 3), target), weight, ssim))
    loss.backward()
    assert loss.isfinite()
    assert drawn.grad.isfinite().all()
    if valid == "none":
        assert loss == 0
        assert not drawn.grad.any()


@quickly
@given(
    depth=st.sampled_from([0.0, 1e-30, 1.0, 1e30]), alpha=st.sampled_from([0.0, 1e-7, 0.6, 1.0]), known=st.booleans(), valid=st.booleans()
)
def test_the_depth_loss_of_nothing_seen_and_nothing_known(depth, alpha, known, valid):
    drawn, cover = torch.full((5, 4), depth, requires_grad=True), torch.full((5, 4), alpha, requires_grad=True)
    loss = inverse_depth(drawn, cover, torch.full((5, 4), float(known)), torch.full((5, 4), float(valid)))
    loss.backward()
    assert loss.isfinite()
    assert drawn.grad.isfinite().all()
    assert cover.grad.isfinite().all()
    assert loss == 0 or (known and valid and alpha > 0.5)


def test_smoothness_and_rigidity_of_nothing():
    latent = torch.zeros(6, 3, requires_grad=True)
    region_smoothness(latent, torch.zeros(6, dtype=torch.int64), 4).backward()  # three empty regions
    assert not latent.grad.any()
    still = torch.zeros(5, 3, requires_grad=True)
    rigidity(still, torch.tensor([[1], [0], [3], [2], [0]]), torch.ones(5, 1)).backward()
    assert still.grad.isfinite().all()
    nothing = angular(torch.zeros(0, 3), torch.zeros(0, 3))
    assert nothing.shape == (0,)


@pytest.fixture(scope="module")
def small_frames(tmp_path_factory):
    return TrainingFrames(MemoryClip(5), 1 << 20, torch.device("cpu"))


@pytest.mark.parametrize("kind", teacher_kinds())
def test_teachers_of_any_vectors(small_frames, kind):
    teacher = SpoiltTeacher(small_frames, teacher_kinds()[kind])
    if kind == "all vectors zero":
        with pytest.raises(DegenseError, match="labels no training frame"):
            SemanticTargets(teacher, small_frames)
        return
    targets = SemanticTargets(teacher, small_frames)
    target = targets.target(0)
    assert target.latents.isfinite().all()
    left_out = kind in ("one vector zero", "one vector NaN", "one vector infinite")
    assert set(target.index[target.index >= 0].tolist()) == ({1} if left_out else {0, 1})
    assert torch.allclose(target.latents.norm(dim=1)[int(left_out) :], torch.ones(2 - left_out), atol=0.02)


def test_supervision_is_kept_only_while_there_is_room(monkeypatch):
    frames = TrainingFrames(MemoryClip(12), 1 << 20, torch.device("cpu"))
    ample = SemanticTargets(SpoiltTeacher(frames, lambda vectors: vectors), frames)
    monkeypatch.setattr(semantics, "TARGET_BYTES", 3 * 48 * 40 * semantics.PIXEL_BYTES)
    tight = SemanticTargets(SpoiltTeacher(frames, lambda vectors: vectors), frames)
    for frame in [*tight.frames, *tight.frames]:
        for name, value in vars(ample.target(frame)).items():
            assert np.array_equal(value, getattr(tight.target(frame), name)), name
    assert tight._targets.size == 3
    assert ample._targets.size == len(ample.frames)
    kept = ample.target(0)
    assert sum(part.nbytes for part in (kept.index, kept.weight, kept.regions)) <= 48 * 40 * semantics.PIXEL_BYTES


def test_scores_of_nothing_are_none_and_never_nan():
    images, masks, motion = ImageScores(), MaskScores(("liver", "gallbladder", "absent")), MotionScores(None)
    picture, nothing = np.zeros((16, 16, 3), np.uint8), np.zeros((16, 16), bool)
    images.add(picture, picture, nothing)
    masks.add(np.full((16, 16), UNLABELLED, np.uint8), np.full((16, 16), UNLABELLED, np.uint8), nothing)
    motion.add(np.full((16, 16), np.nan), np.full((16, 16, 3), np.nan), nothing)
    assert images.result()["psnr_mask"] is None
    assert images.result()["psnr_full"] == 100
    assert masks.result()["miou"] is None
    assert all(value in (None, 0.0, {}) for value in motion.result().values())
    labels = np.zeros((16, 16), np.uint8)
    masks.add(labels, labels)
    assert masks.result()["miou"] == 1
    assert masks.result()["iou"] == {"liver": 1.0, "gallbladder": None, "absent": None}
