"""How the look of a place has changed since the reference frame, wherever it has moved meanwhile."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.layers.layer import Layer, LayerRequest
from degense.engine.scene import Scene


def colour_difference(here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """ΔE*ab of two sRGB colours, float [H, W, 3] in [0, 1]: their distance in CIELAB (1976), float32 [H, W]; NaN where one is."""
    lab = [cv2.cvtColor(np.clip(colours, 0, 1).astype(np.float32), cv2.COLOR_RGB2Lab) for colours in (here, there)]
    return np.linalg.norm(lab[0] - lab[1], axis=-1).astype(np.float32)


def _pixels(scene: Scene, request: LayerRequest) -> np.ndarray:
    drawn = scene.render(request.frame, request.camera, ("rgb", "alpha", "before"))
    shown = drawn["rgb"] / np.maximum(drawn["alpha"], 0.5)[..., None]
    return np.where(np.isfinite(drawn["before"][..., 0]), colour_difference(shown, np.nan_to_num(drawn["before"])), np.float32(np.nan))


def _splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    """Of each Gaussian's own colour; blood and char that come have no earlier one, and hardly change."""
    now, before = (scene.splats(frame).colors.cpu().numpy()[:, None] for frame in (request.frame, scene.reference_frame))
    return colour_difference(now, before)[:, 0]


APPEARANCE = Layer(
    "appearance",
    "scalar",
    "How much the look of tissue has changed since the reference frame, wherever it has moved meanwhile: the distance in CIELAB between "
    "the picture and the colours that this tissue had then, drawn where it is now. About 2 can just be seen; charred or bled tissue "
    "has 10 and more. What lies in front of tissue, as instruments do, differs too.",
    _pixels,
    _splats,
    lambda scene: "ΔE",
    "magma",
    from_zero=True,
)
