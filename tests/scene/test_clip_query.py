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
from degense.engine.scene.clip_query import decode_frame, query_clip
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.prompts import DECODERS, PromptSet

PROMPTS = ("liver", "tool", "gallbladder, not liver", "Fett", "tool, not grasper")


@pytest.fixture
def fresh(scene):
    """The run with empty caches."""
    return lambda: Scene(scene.run, scene.model, scene.basis, scene.encoder, scene.clip, observability=scene.observability)


@pytest.mark.parametrize("decoder", DECODERS)
def test_the_whole_clip_at_once_is_every_prompt_on_every_frame_alone(fresh, decoder):
    asked = PromptSet(PROMPTS, ("connective tissue",), decoder, 0.4)
    together = list(query_clip(fresh(), asked))
    assert [frame for frame, _ in together] == list(range(9))
    for frame, found in together[::4]:
        for text, mask in zip(PROMPTS, found.masks, strict=True):
            request = LayerRequest(frame, prompt_set=replace(asked, prompts=(text,)))
            alone = LAYERS["mask"].image(fresh(), request).values.astype(bool)  # a scene that has computed nothing yet
            np.testing.assert_array_equal(mask, alone)
            np.testing.assert_array_equal(mask, decode_frame(fresh(), request.prompt_set, frame).masks[0])
        np.testing.assert_allclose(found.areas, found.masks.mean((1, 2)))
    assert together[4][1].masks[:3].any((1, 2)).all()


def test_label_maps_hold_the_most_similar_of_overlapping_masks_and_then_the_narrower(fresh):
    """The order of prompts decides no more: a grasper is as similar to "tool" as to "grasper", and the narrower owns it."""
    scene, texts = fresh(), ("tool", "grasper", "liver")
    [(_, found)] = query_clip(scene, PromptSet(texts), [5])
    assert (found.labels[~found.masks.any(0)] == UNLABELLED).all()
    narrow_first = [1, 2, 0]
    similarity = np.stack([scene.query(5).refined(scene.included(texts[k])) for k in narrow_first])
    expected = np.array(narrow_first)[np.where(found.masks[narrow_first], similarity, -np.inf).argmax(0)]
    np.testing.assert_array_equal(found.labels[found.masks.any(0)], expected[found.masks.any(0)])


def test_kept_maps_answer_as_new_ones(fresh):
    scene, asked = fresh(), PromptSet(("liver", "hook"))
    first = list(query_clip(scene, asked, [3, 4]))
    list(query_clip(scene, PromptSet(("fat", "grasper")), [3, 4]))
    for (_, before), (_, after) in zip(first, query_clip(scene, asked, [3, 4]), strict=True):
        np.testing.assert_array_equal(before.masks, after.masks)


def test_as_many_frames_are_in_flight_as_memory_allows(fresh, monkeypatch):
    monkeypatch.setattr(clip_query, "IN_FLIGHT_BYTES", 1)
    frames: list[int] = []
    original = Scene.query

    def counted(self: Scene, frame: float, camera=None) -> FrameSemantics:
        frames.append(int(frame))
        return original(self, frame, camera)

    monkeypatch.setattr(Scene, "query", counted)
    steps = query_clip(fresh(), PromptSet(("liver",)))
    assert [frame for frame, _ in itertools.islice(steps, 3)] == [0, 1, 2]
    assert frames == [0, 1, 2]
    steps.close()
    assert frames == [0, 1, 2]


def test_what_cannot_be_answered_is_said_before_anything_is_drawn(fresh, speechless):
    with pytest.raises(PromptError, match="'banana'"):
        next(query_clip(fresh(), PromptSet(("liver", "banana"))))
    with pytest.raises(PromptError, match="at least one prompt"):
        next(query_clip(fresh(), PromptSet()))
    with pytest.raises(PromptError, match="at most 255 prompts"):
        PromptSet(("liver",) * 256)
    with pytest.raises(PromptError, match="no decoder 'magic'"):
        PromptSet(("liver",), decoder="magic")
    with pytest.raises(DegenseError, match="without semantics"):
        next(query_clip(speechless, PromptSet(("liver",))))
