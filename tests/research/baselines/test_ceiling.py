"""The ceiling of masks: labels of training frames along the true motion, without a look at the held-out frame's labels of tissue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.research import surgeries  # noqa: F401  adds the kind "family"
from degense.engine.research.baselines.ceiling import MASK_CEILING, best_labels, mask_ceiling
from degense.engine.research.baselines.masks import nearest, score_labels

SURGERY, HELD_OUT = 84, 9  # its camera drifts far


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ceiling") / "clip"
    make_phantom(folder, PhantomOptions(12, 96, 80, SURGERY, 8.0, kind="family"))
    return open_clip(folder)


@pytest.fixture(scope="module")
def truth(clip):
    return clip.truth()


def test_a_perfect_scene_is_above_a_copied_frame(clip):
    [(name, ceiling)] = mask_ceiling(clip).items()
    copied = score_labels(clip, clip.test_frames, lambda frame: clip.labels(nearest(frame, clip.train_frames)))
    assert name == MASK_CEILING
    assert ceiling["mask_frames"] == [1, 9]
    assert copied["miou"]["labels"] + 0.02 < ceiling["miou"]["labels"] <= 1


def test_tissue_is_called_by_other_frames_alone(clip, truth, monkeypatch):
    found, tissue = best_labels(clip, truth, HELD_OUT), np.isfinite(truth.displacement[HELD_OUT][..., 0])
    assert np.mean(found[tissue] == clip.labels(HELD_OUT)[tissue]) > 0.98
    told = clip.labels
    monkeypatch.setattr(clip, "labels", lambda frame: np.zeros_like(told(0)) if frame == HELD_OUT else told(frame))
    assert np.array_equal(best_labels(clip, truth, HELD_OUT)[tissue], found[tissue])


def test_wrong_motion_lowers_it(clip, truth):
    """Tissue that is said to have moved by 4 pixels less than it did gets the labels of other places."""
    pixel = float(np.median(clip.depth(HELD_OUT))) / clip.cameras[0].fx
    moved = truth.displacement.copy()
    moved[HELD_OUT, ..., 0] -= 4 * pixel
    tissue = np.isfinite(moved[HELD_OUT][..., 0])
    labels, wrong = clip.labels(HELD_OUT), best_labels(clip, replace(truth, displacement=moved), HELD_OUT)
    right = best_labels(clip, truth, HELD_OUT)
    assert np.mean((wrong == labels)[tissue]) + 0.02 < np.mean((right == labels)[tissue])


def test_without_labels_near_by_there_is_none(clip, monkeypatch):
    monkeypatch.setattr(type(clip), "labelled_frames", property(lambda self: [0, 1, 9]))
    assert mask_ceiling(clip) == {}


def test_an_instrument_that_no_near_frame_shows_is_lost(clip, truth, monkeypatch):
    """A corner that the truth calls an instrument's in the held-out frame alone is left unlabelled."""
    told, moved = clip.labels, truth.displacement.copy()
    strange = len(clip.classes)
    moved[HELD_OUT, :10, :10] = np.nan

    def labels(frame):
        found = told(frame).copy()
        if frame == HELD_OUT:
            found[:10, :10] = strange
        return found

    monkeypatch.setattr(clip, "labels", labels)
    found = best_labels(clip, replace(truth, displacement=moved), HELD_OUT)
    assert (found[:10, :10] == UNLABELLED).all()
