"""Prompts asked of every frame of a scene: masks, label maps and areas over time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numba import njit

from degense.engine.camera import Camera
from degense.engine.clip import UNLABELLED
from degense.engine.errors import PromptError
from degense.engine.scene import Scene
from degense.engine.semantics.masks import DEFAULT_DECODER, DEFAULT_THRESHOLD, PendingMaps, Question

#: Similarities of frames whose masks are being decoded while the next is drawn: what bounds the memory of a clip of any length.
IN_FLIGHT_BYTES = 512 << 20
#: Threads that read and decode. Few keep up with a GPU, and more of them only wait for each other's memory.
READERS = 4


@dataclass(frozen=True)
class ClipQuestion:
    """What is asked of each frame.

    Attributes
    ----------
    prompts : tuple of str
        At most 255.
    decoder : str
    threshold : float
    negatives : tuple of str
        Texts that take pixels from the masks of all prompts.
    """

    prompts: tuple[str, ...]
    decoder: str = DEFAULT_DECODER
    threshold: float = DEFAULT_THRESHOLD
    negatives: tuple[str, ...] = ()

    def questions(self, scene: Scene) -> list[Question]:
        """The prompts in vectors. PromptError for a word that is not understood, DegenseError without semantics."""
        if not 1 <= len(self.prompts) <= UNLABELLED:
            raise PromptError(f"A clip is asked for 1 to {UNLABELLED} prompts at once, not {len(self.prompts)}.")
        others = [scene.meanings(text) for text in self.negatives]
        return [Question(scene.meanings(text), np.concatenate([scene.exclusions(text), *others])) for text in self.prompts]


@dataclass(frozen=True)
class FrameMasks:
    """The answer of a frame.

    Attributes
    ----------
    frame : int
    masks : bool [n, H, W]
        One for each prompt; they may overlap.
    labels : uint8 [H, W]
        Index of the prompt whose mask holds the pixel, of several the most similar; `UNLABELLED` where none does.
    """

    frame: int
    masks: np.ndarray
    labels: np.ndarray

    @property
    def areas(self) -> np.ndarray:
        """Share of the picture that each mask covers, float64 [n]."""
        return self.masks.mean((1, 2))


def query_clip(scene: Scene, asked: ClipQuestion, frames: Sequence[int] | None = None) -> Iterator[FrameMasks]:
    """Answer prompts frame after frame, in order; close the generator to stop.

    Drawing, superpixels and similarities of a frame are computed once for all prompts, on the scene's device; they are read and their
    masks decoded in threads beside that. Each mask is exactly what `MaskQuery.mask` finds for its prompt alone.
    No more than `IN_FLIGHT_BYTES` wait there.

    Parameters
    ----------
    scene : Scene
    asked : ClipQuestion
    frames : sequence of int, optional
        All by default.
    """
    questions, classes = asked.questions(scene), scene.vectors(scene.classes) if scene.classes else None
    width, height = scene.clip_size
    most = max(1, IN_FLIGHT_BYTES // (width * height * 4 * 3 * len(questions)))
    waiting: deque[Future[FrameMasks]] = deque()
    with ThreadPoolExecutor(max_workers=min(READERS, torch.get_num_threads()), thread_name_prefix="decode") as pool:
        try:
            for frame in range(scene.frames) if frames is None else frames:
                similarities = scene.query(frame).pending(questions, asked.decoder, classes)
                waiting.append(pool.submit(_decoded, frame, similarities, asked))
                while len(waiting) >= most or (waiting and waiting[0].done()):
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def masks_at(scene: Scene, asked: ClipQuestion, frame: float, camera: Camera | None = None) -> np.ndarray:
    """The masks of one instant, bool [n, H, W], from any camera; None is the surgeon's, whose similarities are kept."""
    classes = scene.vectors(scene.classes) if scene.classes else None
    return scene.query(frame, camera).masks(asked.questions(scene), asked.decoder, asked.threshold, classes)


def _decoded(frame: int, similarities: PendingMaps, asked: ClipQuestion) -> FrameMasks:
    maps = similarities.read()
    masks = np.stack([of_prompt.mask(asked.decoder, asked.threshold) for of_prompt in maps])
    best, similarity = np.full(masks.shape[1:], UNLABELLED, np.uint8), np.full(masks.shape[1:], -np.inf, np.float32)
    for index, (mask, of_prompt) in enumerate(zip(masks, maps, strict=True)):
        _name(mask, of_prompt.similarity, index, best, similarity)
    return FrameMasks(frame, masks, best)


@njit(nogil=True, cache=True)
def _name(mask, similarity, index, best, highest):
    """Give pixels of a mask to a prompt, in place, where no prompt before it is as similar."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if mask[y, x] and similarity[y, x] > highest[y, x]:
                best[y, x], highest[y, x] = index, similarity[y, x]
