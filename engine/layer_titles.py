"""Names and titles of the layers in the order in which they are offered, and headings. They stand apart from layers, which load torch."""

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


def with_unit(title: str, unit: str) -> str:
    """What stands beside numbers, or over a column of them."""
    return f"{title} [{unit}]" if unit else title
