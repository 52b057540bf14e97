"""Consensus over time: votes against an oracle, the estimate of the teacher's reliability, and that exact labels stay as they are."""

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
from degense.engine.training.semantic.consensus import COLOR_SCALE, LEAST, PRIOR_PIXELS, Consensus, Votes, accuracy_of, own_weight
from degense.engine.training.semantic.finished import FinishedGeometry
from degense.engine.training.semantic.targets import SemanticTargets
from degense.engine.training.semantic.vectors import shares_of, words_of
from degense.engine.training.trainer import Trainer
from tests.fakes import MemoryClip

CPU = torch.device("cpu")


def model_for(frames, count=400, color_knots=4):
    torch.manual_seed(0)
    canonical, bounds = initial_gaussians(frames, None, count, 2, np.random.default_rng(0), color_knots)
    canonical["color_residuals"] = 0.1 * torch.randn(canonical["color_residuals"].shape)
    return SceneModel(FieldConfig(rank=2, color_knots=color_knots, resolution=16, time_resolution=4), bounds, canonical)


def test_votes_are_those_of_the_other_frames_where_a_gaussian_is_seen_in_the_colour_it_has_now():
    """Against sums over an explicit matrix of blending weights in NumPy."""
    clip = MemoryClip(5)
    frames = TrainingFrames(clip, 1 << 20, CPU)
    model, votes, random = model_for(frames, 60), Votes(FinishedGeometry(model_for(frames, 60), frames)), np.random.default_rng(1)
    weights, colors, shares = {}, {}, {}
    for frame in (0, 2, 3):
        with torch.no_grad():
            splats = model.at(clip.time(frame), semantics=False).splats
            weights[frame] = rasterize(splats, torch.eye(len(model)), clip.cameras[frame]).image.reshape(-1, len(model)).double().numpy()
        colors[frame], shares[frame] = splats.colors.numpy(), random.dirichlet(np.ones(3), len(weights[frame]))
        shares[frame][: 4 * 48] = 0  # nothing is said here
        votes.add(frame, torch.from_numpy(shares[frame]).float())
    total, count = 0.0, 0.0
    for voter in (0, 3):
        near = np.exp(-((colors[2] - colors[voter]) ** 2).sum(1) / (2 * COLOR_SCALE**2))[:, None]
        total = total + near * (weights[voter].T @ shares[voter])
        count = count + near * (weights[voter].T @ shares[voter].sum(1))[:, None]
    usual = total.sum(0) / count.sum()
    drawn = weights[2] @ ((total + PRIOR_PIXELS * usual) / (count + PRIOR_PIXELS)) + LEAST * usual
    np.testing.assert_allclose(votes.read(2), drawn / drawn.sum(1, keepdims=True), atol=2e-3)


class Erring:
    """Label maps in which this share of cells of 8 pixels has the other name, anew in every frame."""

    pixelwise, name, provenance = True, "erring", "made up"

    def __init__(self, exact, share):
        self.exact, self.share, self.encoder, self.frames = exact, share, exact.encoder, exact.frames

    def targets(self, frame):
        vectors, index = self.exact.targets(frame)
        height, width = index.shape
        wrong = np.random.default_rng(frame).random((height // 8, width // 8)) < self.share
        wrong = np.repeat(np.repeat(wrong, 8, 0), 8, 1) & (index >= 0)
        return vectors, np.where(wrong, 1 - index, index)


@pytest.fixture(scope="module")
def stage():
    clip = MemoryClip(16, 96, 80)
    frames = TrainingFrames(clip, 1 << 20, CPU)
    return clip, frames, model_for(frames), LabelTeacher(clip, EmbeddedEncoder())


@pytest.mark.parametrize("share", [0.0, 0.15, 0.3])
def test_a_teacher_is_corrected_by_itself_and_one_that_is_right_is_left_alone(stage, share):
    clip, frames, model, exact = stage
    targets = SemanticTargets(Erring(exact, share), frames)
    consensus = Consensus(FinishedGeometry(model, frames), targets, 0)
    right, told, counted = 0, 0, 0
    for frame in clip.train_frames:
        _, index, confidence = consensus.answer(frame)
        known, truth = index >= 0, exact.targets(frame)[1]
        assert (known == (truth >= 0)).all()
        assert (confidence[known] >= 0.5).all()
        right += np.count_nonzero((index == truth)[known])
        told += np.count_nonzero((targets.answer(frame)[1] == truth)[known])
        counted += np.count_nonzero(known)
    assert 1 - right / counted < (0.002 if share == 0 else 0.2 * share)
    assert targets.disagreement == pytest.approx(1 - told / counted, abs=0.02)
    assert targets.accuracy == pytest.approx(told / counted, abs=0.03)


def test_a_teacher_that_nothing_contradicts_is_taken_at_its_word_and_asked_once(stage):
    clip, frames, model, exact = stage
    targets, told = SemanticTargets(exact, frames), []
    consensus = Consensus(FinishedGeometry(model, frames), targets, 0, lambda fraction, words: told.append(fraction))
    assert max(told) < 0.5
    for frame in clip.train_frames:
        _, index, confidence = consensus.answer(frame)
        assert np.array_equal(index, targets.answer(frame)[1])
        assert (confidence[index >= 0] == 1).all()
    Consensus(
        FinishedGeometry(model, frames), SemanticTargets(Erring(exact, 0.05), frames), 0, lambda fraction, words: told.append(fraction)
    )
    assert max(told) > 0.5, "one that errs in a twentieth is asked again"


class Lasting(Erring):
    """The same, and a patch of 16 × 16 pixels has the other name in the first half of the clip."""

    patch = np.s_[40:56, 16:32]

    def targets(self, frame):
        vectors, index = super().targets(frame)
        if frame < 8:
            index[self.patch] = 1 - self.exact.targets(frame)[1][self.patch]
        return vectors, index


def held_right(consensus, frame, labels, where=...):
    """What is said of labels, one number a pixel that has any."""
    said = consensus.rightness(frame).numpy().reshape(*labels.shape, -1)[where]
    return np.take_along_axis(said, np.maximum(labels[where], 0)[..., None], -1)[..., 0][labels[where] >= 0]


def test_true_words_are_held_to_be_right_in_the_mean_and_all_others_seldom(stage):
    clip, frames, model, exact = stage
    consensus = Consensus(FinishedGeometry(model, frames), SemanticTargets(Erring(exact, 0.3), frames), 0)
    truths = {frame: exact.targets(frame)[1] for frame in clip.train_frames}
    others = {frame: np.where(truth >= 0, 1 - truth, -1) for frame, truth in truths.items()}
    true, false = (np.concatenate([held_right(consensus, *of_frame) for of_frame in of.items()]) for of in (truths, others))
    assert true.mean() == pytest.approx(1, abs=0.05)
    assert false.mean() < 0.35, "the teacher says so in .3 of the pixels"


def test_a_mistake_that_lasts_is_doubted_though_the_teacher_insists(stage):
    clip, frames, model, exact = stage
    targets = SemanticTargets(Lasting(exact, 0.3), frames)
    consensus = Consensus(FinishedGeometry(model, frames), targets, 0)
    insisted = {frame: targets.answer(frame)[1] for frame in clip.train_frames if frame < 8}
    said = np.concatenate([held_right(consensus, frame, labels, Lasting.patch) for frame, labels in insisted.items()])
    assert said.mean() < 0.75 / targets.accuracy, "which its agreement alone would be"


def test_a_teacher_that_stands_alone_no_oftener_than_chance_is_right():
    assert own_weight(torch.tensor([10, 40, 50, 100])) > 8  # .1 alone, and .4 × .5 expected
    assert own_weight(torch.tensor([60, 20, 20, 100])) == 0
    assert own_weight(torch.tensor([0, 0, 0, 0])) > 0
    assert own_weight(torch.tensor([30, 30, 40, 100])) == pytest.approx(np.log(0.82 / 0.18), abs=1e-4)


def test_the_accuracy_of_one_of_three_raters_follows_from_how_often_they_agree():
    random, many = np.random.default_rng(0), 200_000
    truth = random.integers(0, 50, many)
    said = [np.where(random.random(many) < share, truth, random.integers(0, 50, many)) for share in (0.7, 0.9, 0.8)]
    teacher, votes, looks = said
    alone = [(votes == looks) & (teacher != votes), (teacher == looks) & (votes != looks), (teacher == votes) & (looks != votes)]
    contested = torch.tensor([int(flags.sum()) for flags in (*alone, ~((teacher == votes) & (votes == looks)))])
    assert accuracy_of(contested, many) == pytest.approx((teacher == truth).mean(), abs=0.01)
    assert accuracy_of(torch.tensor([0, 0, 0, 0]), many) == 1.0
    assert accuracy_of(torch.tensor([0, 0, 0, 0]), 0) == 1.0


def test_mixtures_are_taken_apart():
    classes = EmbeddedEncoder().with_classes(("liver", "fat", "grasper")).encode(["liver", "fat", "grasper"])
    shares = np.array([[1, 0, 0], [0.3, 0.7, 0], [0.25, 0.25, 0.5]])
    mixed = (shares @ classes).astype(np.float32)
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    np.testing.assert_allclose(shares_of(mixed, words_of(mixed, classes)), shares, atol=1e-4)
    assert len(words_of(mixed, None)) == 3


@pytest.mark.parametrize("routing", ["paper", "coupled"])
def test_semantics_trained_with_geometry_learn_the_consensus_once_no_gaussian_comes_or_goes(stage, routing):
    _, frames, _, exact = stage
    config = TrainConfig.preset_of("quick", routing=routing, iterations=8, coarse_iterations=2, densify_until=0.5, consensus=True)

    def trainer():
        torch.manual_seed(0)
        targets = SemanticTargets(Erring(exact, 0.3), frames)
        rank = targets.basis.rank
        canonical, bounds = initial_gaussians(frames, None, 300, rank, np.random.default_rng(0), 4)
        field = FieldConfig(routing, rank, color_knots=4, resolution=16, time_resolution=4)
        return Trainer(SceneModel(field, bounds, canonical), frames, targets, None, config, lambda event: None)

    def wrong(semantics):
        """Share of a frame's pixels that the targets call otherwise than the exact labels."""
        target, truth = semantics.target(2), torch.from_numpy(exact.targets(2)[1].ravel())
        return float((target.index != truth)[target.index >= 0].float().mean())

    one = trainer()
    begun = one.state()
    while one.iteration < 4:
        one.step()
    assert wrong(one.semantics) > 0.2
    one.step()
    assert wrong(one.semantics) < 0.1
    other = trainer()
    other.restore(one.state())
    assert torch.equal(other.semantics.target(2).index, one.semantics.target(2).index)
    one.step()
    other.step()
    for name, value in one.model.state_dict().items():
        assert torch.equal(value, other.model.state_dict()[name]), name
    one.restore(begun)
    assert wrong(one.semantics) > 0.2
