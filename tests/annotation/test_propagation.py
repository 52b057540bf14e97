"""One corrected frame carries through time, with the field and without, and says how sure it is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.special import softmax

from degense.engine.annotation.propagation.propagate import expected_iou, propagate, without_islands
from degense.engine.annotation.propagation.votes import FieldVotes, nearness, spans
from degense.engine.camera import Camera
from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.metrics.masks import MaskScores
from degense.engine.scene.states import States
from degense.engine.splats import Splats
from tests.fakes import MovingWall

TOOLS = ("grasper", "L-hook electrocautery")


def carry(clip, corrected, **options):
    steps, told = propagate(clip, corrected, **options), []
    while True:
        try:
            told.append(next(steps)[0])
        except StopIteration as end:
            assert told == sorted(told)
            assert 0 <= told[0] <= told[-1] < 1
            return end.value


@pytest.fixture(scope="module")
def phantom(tmp_path_factory):
    folder = tmp_path_factory.mktemp("carry") / "clip"
    make_phantom(folder, PhantomOptions(frames=24, width=160, height=128), lambda fraction, words: None)
    return open_clip(folder)


@pytest.fixture(scope="module")
def carried(phantom):
    return carry(phantom, {14: phantom.labels(14)})


def test_a_corrected_frame_pays(phantom, carried):
    """The bars of the project, without a run even: 85 % for tissues, 70 % for instruments."""
    scores = MaskScores(phantom.classes)
    for frame, found in carried.items():
        scores.add(found.labels, phantom.labels(frame))
    by_class = scores.result()["iou"]
    assert sorted(carried) == [i for i in range(24) if i != 14]
    assert np.mean([by_class[name] for name in phantom.classes if name not in TOOLS and name != "charred tissue"]) > 0.9
    assert np.mean([by_class[name] for name in TOOLS]) > 0.7


def test_confidence_falls_with_the_truth(phantom, carried):
    means = []
    for frame, found in carried.items():
        scores = MaskScores(phantom.classes)
        scores.add(found.labels, phantom.labels(frame))
        means.append(scores.result()["miou_pairs"])
    confidence = [found.confidence for found in carried.values()]
    assert np.corrcoef(confidence, means)[0, 1] > 0.3
    assert 0 < min(confidence) < max(confidence) <= 1


def test_what_is_not_labelled_is_carried_as_such():
    clip = MovingWall(frames=4)
    labels = np.full(clip.size[::-1], UNLABELLED, np.uint8)
    labels[20:50, 40:70] = 3
    found = carry(clip, {1: labels}, frames=range(1, 3))
    assert sorted(found) == [2]
    assert set(np.unique(found[2].labels)) <= {3, UNLABELLED}
    assert 0.5 * 900 < (found[2].labels == 3).sum() < 1.5 * 900


@pytest.mark.parametrize(
    "corrected", [{}, {0: np.zeros((3, 3), np.uint8)}, {0: np.full((72, 96), UNLABELLED, np.uint8)}], ids=["none", "size", "empty"]
)
def test_nothing_to_carry_is_said(corrected):
    with pytest.raises(DegenseError):
        carry(MovingWall(), corrected)


def test_what_enters_from_outside_of_the_labelled_frame_stays_unlabelled(monkeypatch):
    """A wall that slides in from the left, with looks that tell nothing: nobody has labelled what enters."""
    monkeypatch.setattr("degense.engine.annotation.propagation.propagate.unknown_chance", lambda evidence: np.zeros(evidence.shape[1:]))
    clip = MovingWall(frames=8, velocity=(0.06, 0.0, 0.0), labelled=[0])
    told = {}
    labels = np.where(clip.material(0)[..., 0] > 0, 1, 0).astype(np.uint8)
    found = carry(clip, {0: labels}, tell=lambda frame, _, chance: told.update({frame: chance}))
    column = clip.flow(7, 0)[..., 0] + np.arange(96) + 0.5  # where the points of the last frame lie in the first
    entered, shown = column < -1, column > 2
    assert (found[7].labels[entered] == UNLABELLED).mean() > 0.9
    assert (found[7].labels[shown] == UNLABELLED).mean() < 0.05
    assert told[7][entered].mean() > 0.85
    assert found[7].unknown > 0.1


class SheetStates(States):
    """The states of `TwoSheets`."""

    def __init__(self, scene):
        self.scene, self.model = scene, SimpleNamespace(bounds=torch.zeros(2, 3))

    def splats(self, frame, *, semantics=False):
        return self.scene.splats(frame)

    def advected_means(self, frame):
        return self.scene.splats(frame).means


class TwoSheets:
    """A scene of two sheets of Gaussians that slide to the right, 2 pixels a frame: label them once, and they know where they are."""

    frames, cameras = 10, [Camera(64, 48, 64.0, 64.0, 32.0, 24.0)] * 10

    @property
    def states(self):
        return SheetStates(self)

    def camera(self, frame):
        return self.cameras[frame]

    def splats(self, frame):
        x, y = np.meshgrid(np.arange(-1.2, 1.2, 0.04), np.arange(-1.2, 1.2, 0.04))
        means = np.stack([x.ravel() + 2 * frame / 64 * 2, y.ravel(), np.full(x.size, 2.0)], -1)
        colours = np.where(x.ravel()[:, None] < 0, [0.8, 0.2, 0.2], [0.2, 0.2, 0.8])
        n = x.size
        return Splats(
            means=torch.tensor(means).float(),
            quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
            scales=torch.full((n, 3), 0.02),
            opacities=torch.full((n,), 0.9),
            colors=torch.tensor(colours).float(),
            semantics=torch.zeros(n, 0),
        )


def test_gaussians_take_their_labels_along():
    scene, shape = TwoSheets(), (48, 64)
    labels = np.zeros(shape, np.int64)
    labels[:, 32:] = 1
    votes = FieldVotes(scene, {0: labels}, {0: np.ones(shape, bool)}, 2)
    picture = np.zeros((*shape, 3), np.uint8)
    picture[:, :42], picture[:, 42:] = (204, 51, 51), (51, 51, 204)
    found = votes.at(5, picture)
    assert (found[:, 10:40].argmax(-1) == 0).all()
    assert (found[:, 44:].argmax(-1) == 1).all()
    assert found[:, 20:40].sum(-1).mean() > 0.7
    strange = votes.at(5, np.full((*shape, 3), 255, np.uint8))  # something else is recorded there
    assert strange.max() < 0.1
    outside = votes.outside(5)  # the sheets have moved by 10 pixels
    assert outside[:, :9].all()
    assert not outside[:, 11:60].any()
    nowhere = FieldVotes(scene, {0: labels}, {0: np.zeros(shape, bool)}, 2)
    assert nowhere.at(0, picture).max() == 0


def test_ways_end_before_the_next_corrected_frame():
    assert list(spans([2, 5], 0, 7)) == [[2, 3, 4], [2, 1, 0], [5, 6, 7], [5, 4, 3]]
    assert list(spans([0], 0, 0)) == []
    assert nearness(3, [1, 4]).tolist() == pytest.approx([0.2, 0.8])


def test_specks_go_to_the_next_best_class():
    scores = np.zeros((60, 60, 3))
    scores[..., 0], scores[..., 2] = 1.0, 0.5
    scores[5:7, 5:6, 1] = 2.0
    scores[20:50, 20:50, 1] = 2.0
    winners = without_islands(scores, np.array([2600.0, 1000.0, 100.0]))
    assert winners[5, 5] == 0
    assert (winners[20:50, 20:50] == 1).all()
    assert (without_islands(scores, np.array([2600.0, 20_000.0, 100.0])) == 0).all()  # a class that shrinks so far is not there
    assert expected_iou(softmax(50 * scores, -1), scores.argmax(-1)) == pytest.approx(1.0, abs=1e-3)
    assert expected_iou(softmax(scores / 2, -1), scores.argmax(-1)) < 0.6


def test_the_expected_iou_is_that_of_labels_drawn_by_their_chances_and_what_is_unknown_is_no_class():
    random = np.random.default_rng(0)
    chances = softmax(3 * random.normal(size=(60, 60, 4)) + [0, 0, 1, 0], -1)
    winners = chances.argmax(-1)
    drawn = (random.random((50, 60, 60, 1)) > chances.cumsum(-1)).sum(-1)
    for classes in (4, 3):  # of three, the fourth is unknown: its pixels have no name, and may be of any class
        ious = [
            [((winners == k) & (labels == k)).sum() / ((winners == k) | (labels == k)).sum() for k in range(classes)] for labels in drawn
        ]
        assert expected_iou(chances[..., :classes], winners) == pytest.approx(np.mean(ious), abs=0.005)
    assert expected_iou(chances[..., :0], winners) == 0
