"""From a layer's values to colours, and the range that its colours span."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from degense.engine.colour_maps import CLASS_COLOURS, hatched
from degense.engine.colour_maps import colourise as colourise_values
from degense.engine.layers.layer import Layer, LayerImage, LayerRequest, RangeMode
from degense.engine.scene import Scene

#: Frames, spread over the sequence, whose values make up the range of the whole sequence.
SEQUENCE_SAMPLES = 9
#: Percentage of the values cut off at each end, so that a few stray pixels do not darken all others.
DEFAULT_CLIP = 1.0
#: Okabe–Ito without black: the first of the classes.
MASK_COLOURS = np.array(CLASS_COLOURS[:7], np.uint8)


def colourise(image: LayerImage, low: float, high: float, cmap: str = "viridis") -> np.ndarray:
    """uint8 [H, W, 3]. Scalars run through `cmap` from `low` to `high`, hatched where they are uncertain; mask k takes the k-th class
    colour, nothing is black."""
    if image.kind == "colour":
        return (np.clip(image.values, 0, 1) * 255 + 0.5).astype(np.uint8)
    if image.kind == "scalar":
        colours = colourise_values(image.values, cmap, low, high)
        return colours if image.uncertain is None else hatched(colours, image.uncertain)
    table = np.zeros((256, 3), np.uint8)
    table[1:] = MASK_COLOURS[np.arange(255) % len(MASK_COLOURS)]
    return table[image.values]


def layer_range(scene: Scene, layer: Layer, request: LayerRequest, mode: RangeMode, clip: float = DEFAULT_CLIP) -> tuple[float, float]:
    """Colour range (low, high) of a scalar layer: percentiles `clip` and 100 − `clip` of this frame, or over frames spread across the whole
    sequence. Layers that grow from zero start there; signed ones are symmetric about it.

    Raises
    ------
    ValueError
        For a `clip` outside [0, 50).
    """
    if not 0 <= clip < 50:
        raise ValueError(f"a range can leave out 0 to 50 percent at each end, not {clip}")
    if layer.fixed_range is not None:
        return layer.fixed_range
    frames = [request.frame] if mode == "frame" else np.unique(np.linspace(0, scene.frames - 1, SEQUENCE_SAMPLES).round())
    values = []
    for frame in frames:
        pixels = layer.pixels(scene, replace(request, frame=float(frame)))
        values.append(pixels[np.isfinite(pixels)])
    known = np.concatenate(values)
    if known.size == 0:
        return 0.0, 1.0
    if layer.signed:
        high = max(float(np.percentile(np.abs(known), 100 - clip)), 1e-6)
        return -high, high
    low, high = np.percentile(known, [clip, 100 - clip])
    if layer.from_zero:
        low = 0.0
    return float(low), float(max(high, low + 1e-6))
