"""Layers of the semantic latent: its directions as colours, similarities with prompts, and their masks."""

from __future__ import annotations

import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.layers.layer import Layer, LayerRequest
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import decode_frame, decode_splats, splat_semantics
from degense.engine.semantics.prompts import PromptSet


def _as_colours(scene: Scene, latents: np.ndarray) -> np.ndarray:
    if not scene.has_semantics:
        raise DegenseError(f"{scene.name} was trained without semantics, so it has no features to show")
    direction = latents / np.maximum(np.linalg.norm(latents, axis=-1, keepdims=True), 1e-6)
    return np.clip(direction @ scene.states.feature_axes * 0.5 + 0.5, 0, 1).astype(np.float32)


def _features(scene: Scene, request: LayerRequest) -> np.ndarray:
    return _as_colours(scene, scene.render(request.frame, request.camera, ("latent",))["latent"])


def _features_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    return _as_colours(scene, scene.splats(request.frame, semantics=True).semantics.cpu().numpy())


def _prompted(request: LayerRequest) -> PromptSet:
    if not request.prompt_set.prompts:
        raise DegenseError("this layer shows what a prompt finds; give at least one prompt")
    return request.prompt_set


def _included(scene: Scene, request: LayerRequest) -> np.ndarray:
    return np.concatenate([scene.included(text) for text in _prompted(request).prompts])


def _similarity(scene: Scene, request: LayerRequest) -> np.ndarray:
    return scene.query(request.frame, request.camera).similarity(_included(scene, request))


def _similarity_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    included = _included(scene, request)
    return splat_semantics(scene, request.frame).similarity(included)[0]


def _mask(scene: Scene, request: LayerRequest) -> np.ndarray:
    return decode_frame(scene, _prompted(request), request.frame, request.camera, request.pixelwise).numbers


def _mask_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    return decode_splats(scene, _prompted(request), request.frame).numbers


FEATURES = Layer(
    "features",
    "colour",
    "Direction of the semantic latent, along the three axes in which this scene's latents differ most, as red, green and blue.",
    _features,
    _features_splats,
    needs_semantics=True,
)
SIMILARITY = Layer(
    "similarity",
    "scalar",
    "Cosine between the pixel's latent and the prompt's text vector; with several prompts the largest.",
    _similarity,
    _similarity_splats,
    lambda scene: "cosine",
    "magma",
    fixed_range=(0.0, 1.0),
    needs_semantics=True,
    needs_prompt=True,
)
MASKS = Layer(
    "mask",
    "mask",
    "Pixels each prompt finds: superpixel means of the similarity, guided filter, threshold, holes filled (decoder rnse), "
    "or the plain decoders. Where masks overlap, the most similar prompt.",
    _mask,
    _mask_splats,
    needs_semantics=True,
    needs_prompt=True,
)
