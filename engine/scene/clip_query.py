"""Prompts decoded on a scene: on a frame, on its Gaussians, or on every frame of the clip."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import torch

from degense.engine.camera import Camera
from degense.engine.clip import UNLABELLED
from degense.engine.errors import PromptError
from degense.engine.scene.scene import Scene
from degense.engine.semantics.masks import Decoded, FrameSemantics
from degense.engine.semantics.prompts import PromptSet, PromptVectors
from degense.engine.threads import abandonable_pool
from degense.engine.vocabulary.questions import AnyOf, ButNot, Expression, Noun, heads, nouns

#: Similarities of frames whose masks are being decoded while the next is drawn: what bounds the memory of a clip of any length.
IN_FLIGHT_BYTES = 512 << 20
#: Threads that read and decode. Few keep up with a GPU, and more of them only wait for each other's memory.
READERS = 4


def encode_prompts(scene: Scene, prompts: PromptSet) -> PromptVectors:
    """Prompts in vectors of the scene's encoder.

    Raises
    ------
    PromptError
        Without a prompt, and for a word that is not understood.
    DegenseError
        Without semantics.
    """
    if not prompts.prompts:
        raise PromptError("There is nothing to look for; give at least one prompt.")
    return encode_expressions(scene, [scene.question(text).what for text in prompts.prompts], prompts)


def encode_expressions(scene: Scene, expressions: Sequence[Expression], prompts: PromptSet) -> PromptVectors:
    """Questions of a frame in the nouns that answer them, with the negatives, decoder and threshold of a prompt set.

    A negative that is a question takes its own mask from the others, a plain one competes in similarity. Raises as `Scene.question` does.
    """
    asked = [scene.question(text).what for text in prompts.negatives]
    for other in asked:
        if not isinstance(other, Noun):
            expressions = [ButNot(expression, other) for expression in expressions]
    texts = [expression.text for expression in expressions if isinstance(expression, Noun)]
    plain = len(texts) == len(expressions)
    if not plain:
        texts = list(dict.fromkeys(text for expression in expressions for text in nouns(expression)))
    negatives = [scene.included(other.text) for other in asked if isinstance(other, Noun)]
    excluded = tuple(np.concatenate([scene.excluded(text), *negatives]) for text in texts)
    classes = scene.vectors(scene.classes) if scene.classes else None
    found = PromptVectors(tuple(map(scene.included, texts)), excluded, classes, prompts.decoder, prompts.threshold)
    return found if plain else replace(found, nouns=tuple(texts), questions=tuple(expressions))


def decode_frame(scene: Scene, prompts: PromptSet, frame: float, camera: Camera | None = None, pixelwise: bool = False) -> Decoded:
    """Masks bool [n, H, W] and labels of one instant, from any camera; None is the surgeon's, whose similarities are kept.

    `pixelwise` as in `FrameSemantics.decode`. Raises as `encode_prompts` does.
    """
    return scene.query(frame, camera).decode(encode_prompts(scene, prompts), pixelwise)


def decode_splats(scene: Scene, prompts: PromptSet, frame: float) -> Decoded:
    """Masks bool [n, N] and labels [N] of the Gaussians at one instant: the decoder without regions, on each Gaussian's own latent.

    Relations are those that the surgeon sees: a Gaussian answers a question when its mask there holds it. Raises as `encode_prompts` does.
    """
    asked = encode_prompts(scene, prompts)
    of_nouns = replace(asked, questions=tuple(AnyOf(tuple(map(Noun, heads(question)))) for question in asked.questions))
    found = splat_semantics(scene, frame).decode(of_nouns)
    masks, labels = found.masks[:, 0], found.labels[0]
    if asked.questions:
        plain = np.array([isinstance(question, Noun) for question in asked.questions])
        masks = masks & (plain[:, None] | _seen(scene, decode_frame(scene, prompts, frame).masks, frame))
        lost = (labels != UNLABELLED) & ~masks[np.minimum(labels, len(masks) - 1), np.arange(len(labels))]
        labels = np.where(lost, np.where(masks.any(0), masks.argmax(0), UNLABELLED), labels).astype(np.uint8)
    return Decoded(masks, labels)


def _seen(scene: Scene, masks: np.ndarray, frame: float) -> np.ndarray:
    """Which Gaussians the surgeon's masks [n, H, W] hold, bool [n, N]."""
    position, depth = scene.camera(frame).project(scene.splats(frame).means.cpu().numpy())
    column, row = np.floor(position).astype(np.int64).T
    inside = (depth > 0) & (column >= 0) & (column < masks.shape[2]) & (row >= 0) & (row < masks.shape[1])
    return inside & masks[:, np.where(inside, row, 0), np.where(inside, column, 0)]


def splat_semantics(scene: Scene, frame: float) -> FrameSemantics:
    """The latents of the Gaussians at one instant as one line of N pixels without a picture. The scene must have semantics."""
    assert scene.basis is not None
    latents, labelled = scene.splats(frame, semantics=True).semantics, scene.renderer.labelled
    known = labelled.splats()[None] if labelled is not None else None
    return FrameSemantics(None, (latents if latents.is_cuda else latents.numpy())[None], scene.basis, known=known)


def query_clip(scene: Scene, prompts: PromptSet, frames: Sequence[int] | None = None) -> Iterator[tuple[int, Decoded]]:
    """Decode prompts frame after frame (all by default), in order, as (frame, masks and labels); close the generator to stop.

    Drawing, superpixels and similarities of a frame are computed once for all prompts, on the scene's device; they are read and their
    masks decoded in threads beside that. Each mask is exactly what `decode_frame` finds for its prompt alone.
    No more than `IN_FLIGHT_BYTES` wait there. Raises as `encode_prompts` does.
    """
    yield from decode_frames(scene, encode_prompts(scene, prompts), range(scene.frames) if frames is None else frames)


def decode_frames(scene: Scene, asked: PromptVectors, frames: Sequence[int]) -> Iterator[tuple[int, Decoded]]:
    """`query_clip` of what is encoded already."""
    width, height = scene.clip_size
    most = max(1, IN_FLIGHT_BYTES // (width * height * 4 * 3 * len(asked.included)))
    waiting: deque[tuple[int, Future[Decoded]]] = deque()
    with abandonable_pool(min(READERS, torch.get_num_threads()), "decode") as pool:
        for frame in frames:
            waiting.append((frame, pool.submit(scene.query(frame).pending(asked).read)))
            while len(waiting) >= most or (waiting and waiting[0][1].done()):
                done, decoded = waiting.popleft()
                yield done, decoded.result()
        while waiting:
            done, decoded = waiting.popleft()
            yield done, decoded.result()
