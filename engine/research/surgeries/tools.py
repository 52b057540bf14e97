"""Further instruments of surgeries."""

from __future__ import annotations

import numpy as np

from degense.engine.data.synthetic.tools import METAL, Tool, direction, join, shaft, tube


def scissors(tip: np.ndarray, back: np.ndarray, opening: float, label: int) -> Tool:
    """Scissors whose blades open by `opening` radians each."""
    pivot = tip + 13.0 * back
    spread = np.cross(back, direction(0.3, 0.2, -0.9))
    spread /= np.linalg.norm(spread)
    parts = [shaft(pivot + 4 * back, back, 2.3)]
    parts.append(tube(np.stack([pivot - back, pivot + back, pivot + 5 * back]), np.array([1.2, 1.9, 2.1]), METAL))
    for sign in (-1.0, 1.0):
        u = np.linspace(0, 1, 7)[:, None]
        line = pivot - 13.5 * u * back + sign * (u * np.tan(opening) * 13.0 + 0.35 * (1 - u)) * spread
        parts.append(tube(line, np.linspace(1.2, 0.35, 7), METAL, flat=spread))
    return join(parts, label)


def suction(tip: np.ndarray, back: np.ndarray, label: int) -> Tool:
    """A bare metal tube, two millimetres thick."""
    line = tip + np.linspace(0, 100, 61)[:, None] * back
    return join([tube(line, np.full(61, 1.05), METAL), tube(line[:2], np.array([1.15, 1.15]), (0.06, 0.05, 0.05))], label)
