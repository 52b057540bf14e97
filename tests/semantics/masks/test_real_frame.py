"""On a real frame with a hand-drawn label map: superpixels keep to the anatomy, and region aggregation repairs spoilt features."""

import json

import cv2
import numpy as np
import pytest

from degense.engine.semantics import EmbeddedEncoder, fit_basis
from degense.engine.semantics.masks import FrameSemantics, superpixels
from tests.semantics.masks.scenes import latents, mask_of, overlap


@pytest.fixture
def frame(clips):
    """The annotated frame of a clip: colours, labels and the names of the classes."""
    folder = clips / "cholec160"
    path = next((folder / "labels").glob("*.png"))
    image = next((folder / "images").glob(f"{path.stem}.*"))
    classes = json.loads((folder / "classes.json").read_text())["classes"]
    return cv2.cvtColor(cv2.imread(str(image)), cv2.COLOR_BGR2RGB), cv2.imread(str(path), cv2.IMREAD_UNCHANGED), classes


def test_superpixels_follow_the_anatomy(frame):
    rgb, labels, _ = frame
    regions = superpixels(rgb)
    votes = np.zeros((regions.max() + 1, 256))
    np.add.at(votes, (regions.ravel(), labels.ravel()), 1)
    assert votes.max(1).sum() / labels.size > 0.98


def test_spoilt_features_are_repaired(frame):
    rgb, labels, classes = frame
    encoder = EmbeddedEncoder(classes)
    assert encoder.literal == ()
    vectors = encoder.encode(classes)
    basis = fit_basis(vectors, np.ones(len(vectors)))
    query = FrameSemantics(rgb, latents(np.minimum(labels, len(classes) - 1), basis.project(vectors), 2.0, 0.4, 0.004), basis)
    present = [c for c in range(len(classes)) if (labels == c).any()]
    score = {
        d: np.mean([overlap(mask_of(query, vectors[c], d, 0.5, vectors), labels == c) for c in present])
        for d in ("threshold", "rnse", "rnse+argmax")
    }
    assert score["rnse"] > 0.85 > score["threshold"]
    assert score["rnse+argmax"] > 0.9
