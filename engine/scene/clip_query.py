"""Prompts decoded on a scene: on a frame, on its Gaussians, or on every frame of the clip."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import torch

from degense.engine.camera import Camera
from degense.engine.errors import PromptError
from degense.engine.scene.scene import Scene
from degense.engine.semantics.masks import Decoded, FrameSemantics
from degense.engine.semantics.prompts import PromptSet, PromptVectors

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
    included = tuple(scene.included(text) for text in prompts.prompts)
    negatives = [scene.included(text) for text in prompts.negatives]
    excluded = tuple(np.concatenate([scene.excluded(text), *negatives]) for text in prompts.prompts)
    classes = scene.vectors(scene.classes) if scene.classes else None
    return PromptVectors(included, excluded, classes, prompts.decoder, prompts.threshold)


def decode_frame(scene: Scene, prompts: PromptSet, frame: float, camera: Camera | None = None, pixelwise: bool = False) -> Decoded:
    """Masks bool [n, H, W] and labels of one instant, from any camera; None is the surgeon's, whose similarities are kept.

    `pixelwise` as in `FrameSemantics.decode`. Raises as `encode_prompts` does.
    """
    return scene.query(frame, camera).decode(encode_prompts(scene, prompts), pixelwise)


def decode_splats(scene: Scene, prompts: PromptSet, frame: float) -> Decoded:
    """Masks bool [n, N] and labels [N] of the Gaussians at one instant: the decoder without regions, on each Gaussian's own latent.

    Raises as `encode_prompts` does.
    """
    asked = encode_prompts(scene, prompts)
    found = splat_semantics(scene, frame).decode(asked)
    return Decoded(found.masks[:, 0], found.labels[0])


def splat_semantics(scene: Scene, frame: float) -> FrameSemantics:
    """The latents of the Gaussians at one instant as one line of N pixels without a picture. The scene must have semantics."""
    assert scene.basis is not None
    latents = scene.splats(frame, semantics=True).semantics
    return FrameSemantics(None, (latents if latents.is_cuda else latents.numpy())[None], scene.basis)


def query_clip(scene: Scene, prompts: PromptSet, frames: Sequence[int] | None = None) -> Iterator[tuple[int, Decoded]]:
    """Decode prompts frame after frame (all by default), in order, as (frame, masks and labels); close the generator to stop.

    Drawing, superpixels and similarities of a frame are computed once for all prompts, on the scene's device; they are read and their
    masks decoded in threads beside that. Each mask is exactly what `decode_frame` finds for its prompt alone.
    No more than `IN_FLIGHT_BYTES` wait there. Raises as `encode_prompts` does.
    """
    asked = encode_prompts(scene, prompts)
    width, height = scene.clip_size
    most = max(1, IN_FLIGHT_BYTES // (width * height * 4 * 3 * len(asked.included)))
    waiting: deque[tuple[int, Future[Decoded]]] = deque()
    with ThreadPoolExecutor(max_workers=min(READERS, torch.get_num_threads()), thread_name_prefix="decode") as pool:
        try:
            for frame in range(scene.frames) if frames is None else frames:
                waiting.append((frame, pool.submit(scene.query(frame).pending(asked).read)))
                while len(waiting) >= most or (waiting and waiting[0][1].done()):
                    done, decoded = waiting.popleft()
                    yield done, decoded.result()
            while waiting:
                done, decoded = waiting.popleft()
                yield done, decoded.result()
        finally:
            for _, future in waiting:
                future.cancel()
