"""What looks like what was shown before is familiar, and what does not is new."""

import cv2
import numpy as np
import pytest

from degense.engine.semantics.novelty import Novelty, surroundings, surroundings_by_class

NEW = 3.0


def tissue(seed, color):
    """A textured picture, uint8 [64, 96, 3]."""
    grain = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 60, (64, 96)), (0, 0), 2)
    return np.clip(np.array(color) + grain[..., None], 0, 255).astype(np.uint8)


@pytest.fixture
def novelty():
    labels = np.zeros((64, 96), int)
    labels[:, 48:] = 1
    shown = np.where(labels[..., None] == 0, tissue(0, (150, 70, 60)), tissue(1, (220, 190, 120)))
    drawn = surroundings_by_class(shown, labels, 1500, np.random.default_rng(0))
    assert sorted(drawn) == [0, 1]
    return Novelty(np.concatenate(list(drawn.values())))


@pytest.mark.parametrize("color", [(150, 70, 60), (220, 190, 120)])
def test_another_piece_of_what_was_shown_is_familiar(novelty, color):
    assert np.mean(novelty(tissue(5, color)) < NEW) > 0.9


@pytest.mark.parametrize("color", [(90, 90, 95), (120, 160, 90)])
def test_another_tissue_is_new(novelty, color):
    assert np.mean(novelty(tissue(5, color)) < NEW) < 0.1


def test_what_looks_like_one_class_is_new_beside_the_other(novelty):
    ours, others = (150, 70, 60), (220, 190, 120)
    beside = novelty.beside(surroundings(tissue(0, ours)))
    assert np.mean(beside(tissue(5, ours)) < NEW) > 0.9
    assert np.mean(novelty(tissue(5, others)) < NEW) > 0.9
    assert np.mean(beside(tissue(5, others)) < NEW) < 0.1


def test_unlabelled_pixels_teach_nothing():
    labels = np.full((64, 96), -1)
    labels[:, 48:] = 3
    drawn = surroundings_by_class(tissue(0, (150, 70, 60)), labels, 100, np.random.default_rng(0))
    assert {label: values.shape for label, values in drawn.items()} == {3: (100, 13)}


def test_surroundings_of_few_pixels_do():
    """One labelled pixel of each class: a distance, and no error."""
    picture = tissue(0, (150, 70, 60))
    assert np.isfinite(Novelty(surroundings(picture)[:2])(picture)).all()
