"""A clicked place joins the words of a prompt: what looks like it is found too."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from degense.engine.errors import PromptError
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.examples import Example, split_examples
from degense.engine.semantics.prompts import PromptSet

FRAME = 4


def mask(scene, text: str, frame: int = FRAME) -> np.ndarray:
    return decode_frame(scene, PromptSet((text,)), frame).masks[0]


def inside(found: np.ndarray) -> Example:
    """A place well inside of a mask."""
    y, x = np.unravel_index(cv2.distanceTransform(found.astype(np.uint8), cv2.DIST_L2, 5).argmax(), found.shape)
    return Example(FRAME, int(x), int(y))


def test_a_place_alone_finds_what_it_shows_in_every_frame(scene):
    for name in ("liver", "fat"):
        for frame in (FRAME, 7):
            of_words, of_place = mask(scene, name, frame), mask(scene, str(inside(mask(scene, name))), frame)
            assert (of_words & of_place).sum() > 0.8 * (of_words | of_place).sum()


def test_a_place_widens_the_words(scene):
    liver, fat = mask(scene, "liver"), mask(scene, "fat")
    both = mask(scene, f"liver {inside(fat)}")
    assert (both & liver).sum() > 0.95 * liver.sum()
    assert (both & fat).sum() > 0.8 * fat.sum()
    assert not (mask(scene, "liver") & fat).any()


def test_its_vector_is_what_is_drawn_there(scene):
    place = inside(mask(scene, "liver"))
    words, seen = scene.included(f"liver {place}")
    latent = scene.render(FRAME, what=("latent",))["latent"][place.y, place.x]
    np.testing.assert_allclose(words, scene.included("liver")[0])
    np.testing.assert_allclose(scene.basis.project(seen), latent / np.linalg.norm(latent), atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(seen), 1.0, atol=1e-5)


def test_places_join_questions(scene):
    place = inside(mask(scene, "liver"))
    np.testing.assert_array_equal(mask(scene, f"fat or liver {place}"), mask(scene, "fat") | mask(scene, f"liver {place}"))


def test_what_is_no_place_is_said(scene):
    assert split_examples("liver @1:2,3 lobe @4:5,6") == ("liver lobe", (Example(1, 2, 3), Example(4, 5, 6)))
    width, _ = scene.clip_size
    for text, sentence in (
        ("liver @12", "an @ without a place"),
        ("tool, not grasper @1:2,3", "before the negation"),
        ("liver @99:2,3", "no place @99:2,3: frames go from 0 to 8"),
        (f"liver @1:{width},3", "no place"),
    ):
        with pytest.raises(PromptError, match=sentence):
            scene.question(text)


def test_nothing_is_no_example(scene, monkeypatch):
    empty = {"latent": np.zeros((*scene.clip_size[::-1], scene.basis.rank), np.float32), "alpha": np.zeros(scene.clip_size[::-1])}
    monkeypatch.setattr(scene, "render", lambda *arguments: empty)
    with pytest.raises(PromptError, match="Nothing is reconstructed at @3:4,5"):
        scene.included("@3:4,5")
