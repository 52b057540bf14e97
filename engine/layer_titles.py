"""Names and titles of the layers, in the order in which they are offered. They stand apart from the layers, which load torch."""

from __future__ import annotations

LAYER_TITLES = {
    "rgb": "Colour",
    "depth": "Depth",
    "features": "Features",
    "similarity": "Similarity",
    "mask": "Label map",
    "displacement": "Displacement",
    "uncertainty": "Displacement uncertainty",
    "speed": "Speed",
    "rotation": "Rotation",
    "scale": "Scale change",
    "appearance": "Change of appearance",
    "warp": "Spurious warp",
    "observability": "Motion observability",
}
