"""Whole clips: what is kept and done at once changes nothing, not even the last bit."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError, PromptError
from degense.engine.layers import LAYERS, LayerRequest
from degense.engine.scene import Scene, clip_query
from degense.engine.scene.clip_query import ClipQuestion, masks_at, query_clip
from degense.engine.semantics.masks import DECODERS, FrameSemantics

PROMPTS = ("liver", "tool", "gallbladder, not liver", "Fett", "tool, not grasper")


@pytest.fixture
def fresh(scene):
    """The run with empty caches."""
    return lambda: Scene(scene.run, scene.model, scene.basis, scene.encoder, scene.clip, support=scene.support)


@pytest.mark.parametrize("decoder", DECODERS)
def test_the_whole_clip_at_once_is_every_prompt_on_every_frame_alone(fresh, decoder):
    asked = ClipQuestion(PROMPTS, decoder, 0.4, ("connective tissue",))
    together = list(query_clip(fresh(), asked))
    assert [found.frame for found in together] == list(range(9))
    for found in together[::4]:
        for text, mask in zip(PROMPTS, found.masks, strict=True):
            request = LayerRequest(found.frame, None, (text,), 0.4, decoder, ("connective tissue",))
            alone = LAYERS["mask"].image(fresh(), request).values.astype(bool)  # a scene that has computed nothing yet
            np.testing.assert_array_equal(mask, alone)
            np.testing.assert_array_equal(mask, masks_at(fresh(), replace(asked, prompts=(text,)), found.frame)[0])
        np.testing.assert_allclose(found.areas, found.masks.mean((1, 2)))
    assert together[4].masks[:3].any((1, 2)).all()


def test_label_maps_hold_the_most_similar_of_overlapping_masks(fresh):
    scene = fresh()
    [found] = query_clip(scene, ClipQuestion(("tool", "grasper", "liver")), [5])
    assert (found.labels[~found.masks.any(0)] == UNLABELLED).all()
    similarity = np.stack([scene.query(5).refined(scene.meanings(text)) for text in ("tool", "grasper", "liver")])
    expected = np.where(found.masks, similarity, -np.inf).argmax(0)
    np.testing.assert_array_equal(found.labels[found.masks.any(0)], expected[found.masks.any(0)])


def test_kept_maps_answer_as_new_ones(fresh):
    scene, asked = fresh(), ClipQuestion(("liver", "hook"))
    first = list(query_clip(scene, asked, [3, 4]))
    list(query_clip(scene, ClipQuestion(("fat", "grasper")), [3, 4]))
    for before, after in zip(first, query_clip(scene, asked, [3, 4]), strict=True):
        np.testing.assert_array_equal(before.masks, after.masks)


def test_as_many_frames_are_in_flight_as_memory_allows(fresh, monkeypatch):
    monkeypatch.setattr(clip_query, "IN_FLIGHT_BYTES", 1)
    frames: list[int] = []
    original = Scene.query

    def counted(self: Scene, frame: float, camera=None) -> FrameSemantics:
        frames.append(int(frame))
        return original(self, frame, camera)

    monkeypatch.setattr(Scene, "query", counted)
    steps = query_clip(fresh(), ClipQuestion(("liver",)))
    assert [found.frame for found in itertools.islice(steps, 3)] == [0, 1, 2]
    assert frames == [0, 1, 2]
    steps.close()
    assert frames == [0, 1, 2]


def test_what_cannot_be_answered_is_said_before_anything_is_drawn(fresh, speechless):
    with pytest.raises(PromptError, match="'banana'"):
        next(query_clip(fresh(), ClipQuestion(("liver", "banana"))))
    with pytest.raises(PromptError, match="1 to 255 prompts"):
        next(query_clip(fresh(), ClipQuestion(())))
    with pytest.raises(DegenseError, match="without semantics"):
        next(query_clip(speechless, ClipQuestion(("liver",))))
