"""Semantic supervision: what counts, how much, where it came from, and what its gradient may touch."""

import numpy as np
import pytest
import torch

from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError
from degense.engine.field import FieldConfig, SceneModel
from degense.engine.raster.camera_tensors import view_and_lens
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.masks import superpixels
from degense.engine.semantics.teachers import LabelTeacher
from degense.engine.training.config import TrainConfig
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from degense.engine.training.losses import angular, l1
from degense.engine.training.preparation import semantic_provenance
from degense.engine.training.semantic.targets import SemanticTargets
from degense.engine.training.trainer import Trainer
from tests.fakes import MemoryClip, MovingWall

CPU = torch.device("cpu")


def prepared(clip, max_pixels=1 << 20, motion=False):
    frames = TrainingFrames(clip, max_pixels, CPU)
    flow = FlowSupervision(frames) if motion else None
    teacher = LabelTeacher(clip, EmbeddedEncoder())
    targets = SemanticTargets(teacher, frames)
    if flow is not None:
        targets.propagate(flow)
    return frames, flow, teacher, targets


def drawn(targets, frame, size):
    """The class of each pixel as a picture, −1 where nothing is said."""
    return targets.target(frame).index.numpy().reshape(size[::-1])


def test_targets_say_what_the_labels_say_at_the_working_size():
    clip = MemoryClip(width=96, height=80)
    frames, _, teacher, targets = prepared(clip, max_pixels=48 * 40)
    assert frames.size == (48, 40)
    assert targets.frames == targets.labelled_frames == clip.train_frames
    for frame in clip.train_frames:
        picture = drawn(targets, frame, frames.size)
        expected = clip.labels(frame)[::2, ::2].astype(int)
        expected[expected == UNLABELLED] = -1
        expected[~(clip.valid(frame)[::2, ::2] & clip.valid(frame)[1::2, ::2])] = -1
        assert np.array_equal(picture, expected)
    target = targets.target(0)
    assert target.regions.shape == (48 * 40,)
    assert np.array_equal(target.regions.reshape(40, 48), superpixels(frames.image(0)))
    cosine = torch.nn.functional.normalize(target.latents, dim=1) @ torch.nn.functional.normalize(target.latents, dim=1).T
    assert torch.allclose(cosine, torch.from_numpy(teacher.vectors @ teacher.vectors.T), atol=0.02)


@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_invalid_or_unlabelled_carries_nothing(seed):
    """Whatever the latents are there, loss and gradient stay the same."""
    clip = MemoryClip()
    *_, targets = prepared(clip)
    spoken = (clip.labels(2) != UNLABELLED) & clip.valid(2)
    generator = torch.Generator().manual_seed(seed)
    latent = torch.randn((40, 48, targets.basis.rank), generator=generator)
    other = torch.where(torch.from_numpy(spoken)[..., None], latent, torch.randn(latent.shape, generator=generator))
    losses = [targets.loss(x, 2, distance, 0)["align"] for distance in (angular, l1) for x in (latent, other)]
    assert losses[0] == losses[1]
    assert losses[2] == losses[3]
    latent.requires_grad_()
    targets.loss(latent, 2, angular, 0)["align"].backward()
    assert np.array_equal((latent.grad != 0).any(2).numpy(), spoken)


def test_rare_classes_weigh_more_and_the_mean_weight_is_one():
    *_, targets = prepared(MemoryClip())
    for frame in targets.frames:
        target = targets.target(frame)
        known = target.index >= 0
        assert not target.weight[~known].any()
        assert target.labelled == known.sum()
        assert target.weight[known].mean() == pytest.approx(1, abs=1e-5)
        counts = np.bincount(target.index[known].numpy())
        assert counts[0] > 5 * counts[1]
        weights = [target.weight[target.index == k] for k in (0, 1)]
        assert all(bool((w == w[0]).all()) for w in weights)
        assert float(weights[1][0] / weights[0][0]) == pytest.approx(np.sqrt(counts[0] / counts[1]), rel=1e-4)


def test_the_loss_is_the_weighted_angle():
    *_, targets = prepared(MemoryClip())
    target = targets.target(3)
    latent = torch.randn((40, 48, targets.basis.rank), generator=torch.Generator().manual_seed(3))
    flat, total = latent.view(-1, targets.basis.rank).numpy(), 0.0
    pixels = np.flatnonzero(target.index.numpy() >= 0)
    said = target.index.numpy()[pixels]
    weights = 1 / np.sqrt(np.bincount(said)[said])
    weights /= weights.mean()
    for pixel, index, weight in zip(pixels, said, weights, strict=True):
        a, b = flat[pixel], target.latents[index].numpy()
        total += weight * (1 - a @ b / np.linalg.norm(a) / np.linalg.norm(b))
    assert float(targets.loss(latent, 3, angular, 0)["align"]) == pytest.approx(total / len(weights), rel=1e-4)
    perfect = 7 * target.wanted
    assert targets.loss(perfect.view_as(latent), 3, angular, 0)["align"] < 1e-5
    assert targets.loss(latent, 3, angular, 1.0)["region"] > 0
    assert set(targets.loss(latent, 3, angular, 0)) == {"align"}


@pytest.mark.cuda
@pytest.mark.parametrize("distance", [angular, l1])
def test_the_loss_on_a_gpu_is_that_on_a_processor(distance):
    """One frame after the other: a graph keeps nothing of the frame before."""
    clip = MemoryClip()
    on = {
        device: SemanticTargets(LabelTeacher(clip, EmbeddedEncoder()), TrainingFrames(clip, 1 << 20, torch.device(device)))
        for device in ("cpu", "cuda")
    }
    for frame in clip.train_frames[:3]:
        latent = torch.randn((40, 48, on["cpu"].basis.rank), generator=torch.Generator().manual_seed(frame))
        results = []
        for device, targets in on.items():
            given = latent.to(device, copy=True).requires_grad_()
            terms = targets.loss(given, frame, distance, 0.3)
            sum(terms.values()).backward()
            results.append([*(float(term.detach()) for term in terms.values()), given.grad.cpu()])
        torch.testing.assert_close(*results, rtol=1e-4, atol=1e-6)


def test_sparse_labels_are_carried_with_the_tissue_and_the_run_says_so():
    clip = MovingWall(10, velocity=(0.05, 0.02, 0.0), labelled=[4], hole=np.s_[60:66, 10:20])
    frames, _, teacher, targets = prepared(clip, motion=True)
    assert targets.labelled_frames == [4]
    assert targets.frames == clip.train_frames
    assert (
        semantic_provenance(teacher, targets)
        == f"{teacher.provenance}; propagated along the optical flow to {len(clip.train_frames) - 1} other frames"
    )
    for frame in clip.train_frames:
        picture, truth = drawn(targets, frame, frames.size), clip.material(frame)[..., 0] > 0
        said = picture >= 0
        assert not said[clip.hole].any()
        assert said.mean() > 0.5
        assert (picture[said] == truth[said]).mean() > 0.98, frame
    standing = drawn(targets, 4, frames.size)
    moved = clip.material(9)[..., 0] > 0
    assert (standing[standing >= 0] == moved[standing >= 0]).mean() < 0.98  # labels that stayed behind would be noticed


def test_full_labels_are_not_carried_and_the_run_does_not_say_so():
    clip = MovingWall(10, labelled=range(10))
    _, _, teacher, targets = prepared(clip, motion=True)
    assert targets.frames == targets.labelled_frames == clip.train_frames
    assert semantic_provenance(teacher, targets) == teacher.provenance
    assert semantic_provenance(None, None) == "no semantics"


def test_a_silent_teacher_is_refused_in_one_sentence():
    class Silent:
        pixelwise = True
        name, frames = "mute", (0, 2)

        def targets(self, frame):
            return None

    class Blank(MemoryClip):
        def labels(self, index):
            return np.full((40, 48), UNLABELLED, np.uint8)

    frames = TrainingFrames(MemoryClip(), 1 << 20, CPU)
    with pytest.raises(DegenseError, match=r"'mute' labels no training frame; train with --teacher none"):
        SemanticTargets(Silent(), frames)
    with pytest.raises(DegenseError, match="labels no training frame"):
        SemanticTargets(LabelTeacher(Blank(), EmbeddedEncoder()), frames)


@pytest.mark.parametrize("routing", ["isolated", "paper", "coupled"])
def test_where_the_semantic_loss_of_a_trainer_may_go(routing):
    clip = MemoryClip()
    frames, _, _, targets = prepared(clip)
    canonical, bounds = initial_gaussians(frames, None, 300, targets.basis.rank, np.random.default_rng(0))
    model = SceneModel(FieldConfig(routing, targets.basis.rank, channels=8, resolution=8, time_resolution=4), bounds, canonical)
    torch.manual_seed(1)
    for parameter in model.parameters():  # zero-initialised last layers would hide a way
        if not parameter.any() and parameter is not model.canonical["temporal_windows"]:
            torch.nn.init.normal_(parameter, 0, 0.02)
    trainer = Trainer(model, frames, targets, None, TrainConfig.preset_of("quick", routing=routing, device="cpu"), lambda event: None)
    trainer.iteration = trainer.config.coarse_iterations
    trainer._make_passes((trainer.times[3], view_and_lens(frames.cameras[3], CPU), torch.zeros(0)))
    trainer._semantic_loss(3).total.backward()
    names = {name for name, p in model.named_parameters() if p.grad is not None and bool((p.grad != 0).any())}
    geometry = {name for name, _ in model.named_parameters() if not name.startswith(("semantic", "canonical.semantics"))}
    assert "canonical.semantics" in names
    assert any(name.startswith("semantic.") for name in names)
    if routing == "isolated":
        assert not names & geometry
        assert any(name.startswith("semantic_planes.") for name in names)
    else:
        assert {"canonical.means", "canonical.log_scales", "canonical.logits"} <= names
        assert any(name.startswith("planes.") for name in names)
