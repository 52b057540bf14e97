"""What a pixel or a Gaussian can show: the types of the registry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from engine.camera import Camera
from engine.masks import DEFAULT_DECODER, DEFAULT_THRESHOLD
from engine.scene import Scene

Kind = Literal["colour", "scalar", "mask"]
RangeMode = Literal["frame", "sequence"]


@dataclass(frozen=True)
class LayerRequest:
    """What to show.

    Attributes
    ----------
    frame : float
    camera : Camera or None
        None: the surgeon's camera.
    prompts : tuple of str
        For `similarity` and `mask`.
    threshold : float
        On the cosine.
    decoder : str
        One of `engine.masks.DECODERS`.
    """

    frame: float
    camera: Camera | None = None
    prompts: tuple[str, ...] = ()
    threshold: float = DEFAULT_THRESHOLD
    decoder: str = DEFAULT_DECODER


@dataclass(frozen=True)
class LayerImage:
    """A layer's picture.

    Attributes
    ----------
    values : ndarray
        `colour`: float32 [H, W, 3] in [0, 1]. `scalar`: float32 [H, W], NaN where nothing is known. `mask`: uint8 [H, W], 0 nothing,
        k + 1 prompt k.
    unit : str
    kind : {"colour", "scalar", "mask"}
    """

    values: np.ndarray
    unit: str
    kind: Kind


@dataclass(frozen=True)
class Layer:
    """One entry of the registry.

    Attributes
    ----------
    name, title : str
    kind : {"colour", "scalar", "mask"}
    description : str
        Formula and units, shown to the user.
    cmap : str
        A name in `engine.layers.colour`.
    diverging : bool
        Whether the range is symmetric about zero.
    picture : callable (scene, request) -> ndarray
    per_splat : callable (scene, request) -> ndarray [N] or [N, 3]
    unit_of : callable (scene) -> str
    needs_semantics, needs_clip, needs_prompt : bool
    """

    name: str
    title: str
    kind: Kind
    description: str
    picture: Callable[[Scene, LayerRequest], np.ndarray]
    per_splat: Callable[[Scene, LayerRequest], np.ndarray]
    unit_of: Callable[[Scene], str]
    cmap: str = "viridis"
    needs_semantics: bool = False
    needs_clip: bool = False
    needs_prompt: bool = False

    def unit(self, scene: Scene) -> str:
        return self.unit_of(scene)

    def image(self, scene: Scene, request: LayerRequest) -> LayerImage:
        """Draw the layer. DegenseError when the scene cannot show it."""
        return LayerImage(self.picture(scene, request), self.unit(scene), self.kind)

    def splats(self, scene: Scene, request: LayerRequest) -> np.ndarray:
        """Values of every Gaussian: [N, 3] colours, or [N] scalars (NaN unknown) or mask indices."""
        return self.per_splat(scene, request)

    def missing(self, scene: Scene, prompts: tuple[str, ...]) -> str:
        """Why the scene cannot show this layer now, in one sentence; empty when it can."""
        if self.needs_semantics and not scene.has_semantics:
            return "this run was trained without semantics"
        if self.needs_clip and scene.clip is None:
            return f"this layer compares with the recording, which is missing: {scene.clip_missing}"
        if self.needs_prompt and not prompts:
            return "type a prompt first"
        return ""
