"""What a pixel or a Gaussian can show: the types of the registry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from degense.engine.camera import Camera
from degense.engine.layer_titles import LAYER_TITLES
from degense.engine.scene import NO_OBSERVABILITY, Scene
from degense.engine.semantics.prompts import NO_PROMPTS, PromptSet

Kind = Literal["colour", "scalar", "mask"]
RangeMode = Literal["frame", "sequence"]


@dataclass(frozen=True)
class LayerRequest:
    """What to show."""

    frame: float
    camera: Camera | None = None  # None: the surgeon's
    prompt_set: PromptSet = NO_PROMPTS  # for `similarity` and `mask`
    pixelwise: bool = False  # decode masks pixel by pixel, as a preview that needs no superpixels


@dataclass(frozen=True)
class LayerImage:
    """A layer drawn from a camera.

    Attributes
    ----------
    values : ndarray
        `colour`: float32 [H, W, 3] in [0, 1]. `scalar`: float32 [H, W], NaN where nothing is known. `mask`: uint8 [H, W], 0 nothing,
        k + 1 where prompt k owns the pixel.
    uncertain : bool [H, W] or None
        Pixels whose value is a guess; None where the layer cannot tell.
    """

    values: np.ndarray
    unit: str
    kind: Kind
    uncertain: np.ndarray | None = None


def nowhere(scene: Scene, request: LayerRequest) -> None:
    """No value of the layer is known to be a guess."""


@dataclass(frozen=True)
class Layer:
    """One entry of the registry."""

    name: str  # a key of `LAYER_TITLES`
    kind: Kind
    description: str  # formula and units, shown to the user
    pixels: Callable[[Scene, LayerRequest], np.ndarray]  # as `LayerImage.values`
    splats: Callable[[Scene, LayerRequest], np.ndarray]  # of every Gaussian: [N, 3] colours, or [N] scalars (NaN unknown) or mask values
    unit: Callable[[Scene], str] = lambda scene: ""
    cmap: str = "viridis"  # of `COLOUR_MAPS`
    signed: bool = False  # its range is symmetric about zero
    from_zero: bool = False  # its range starts at zero
    fixed_range: tuple[float, float] | None = None  # the range that it always has; None where the values decide
    of_motion: bool = False  # large values are findings about motion, whose worst frames and places are worth a list
    uncertain: Callable[[Scene, LayerRequest], np.ndarray | None] = nowhere  # bool [H, W], a guess; None where the scene cannot tell
    uncertain_splats: Callable[[Scene, LayerRequest], np.ndarray | None] = nowhere  # bool [N]
    uncertain_words: str = ""  # what that means, for legends
    needs_semantics: bool = False
    needs_clip: bool = False
    needs_prompt: bool = False
    needs_observability: bool = False

    @property
    def title(self) -> str:
        return LAYER_TITLES[self.name]

    def image(self, scene: Scene, request: LayerRequest) -> LayerImage:
        """Draw the layer. DegenseError when the scene cannot show it."""
        return LayerImage(self.pixels(scene, request), self.unit(scene), self.kind, self.uncertain(scene, request))

    def missing(self, scene: Scene, prompts: tuple[str, ...]) -> str:
        """Why the scene cannot show this layer now, in one sentence; empty when it can."""
        if self.needs_semantics and not scene.has_semantics:
            return "this run was trained without semantics"
        if self.needs_clip and scene.clip is None:
            return f"this layer compares with the recording, which is missing: {scene.clip_missing}"
        if self.needs_observability and scene.observability is None:
            return f"this run {NO_OBSERVABILITY}"
        if self.needs_prompt and not prompts:
            return "type a prompt first"
        return ""
