"""A layer's picture in colours."""

from __future__ import annotations

import numpy as np

from degense.engine.colour_maps import colourise as colourise_values
from degense.engine.colour_maps import hatched
from degense.engine.layers.layer import LayerImage

#: Okabe–Ito, the eight colours that colour-blind people tell apart, without black.
MASK_COLOURS = np.array(
    [(230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66), (0, 114, 178), (213, 94, 0), (204, 121, 167)], np.uint8
)


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
