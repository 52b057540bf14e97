"""Meshes of the instruments: tubes of varying radius along a bent line."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

METAL = (0.34, 0.34, 0.36)
DARK = (0.035, 0.035, 0.04)
CERAMIC = (0.62, 0.60, 0.55)
Part = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # vertices, normals, triangles, colours
SIDES = 28


@dataclass(frozen=True)
class Tool:
    """A closed triangle mesh."""

    vertices: np.ndarray  # float64 [V, 3]
    normals: np.ndarray  # float64 [V, 3]
    triangles: np.ndarray  # int32 [F, 3]
    colours: np.ndarray  # float32 [V, 3]; linear RGB
    label: int


def tube(line: np.ndarray, radii: np.ndarray, colour: tuple[float, float, float], flat: np.ndarray | None = None) -> Part:
    """A tube around a polyline [k, 3] with a radius at each point, closed at both ends.

    Returns vertices, normals, triangles and colours. `flat` [3] is a direction across which the tube is half as thick.
    """
    line = np.concatenate([line[:1], line, line[-1:]])
    radii = np.concatenate([[1e-3], radii, [1e-3]])
    tangents = np.gradient(line[1:-1], axis=0)
    tangents = np.concatenate([tangents[:1], tangents, tangents[-1:]])
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    side = np.array([0.3, 0.9, 0.2]) if flat is None else flat
    angles = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    rings, outwards = [], []
    for point, tangent, radius in zip(line, tangents, radii, strict=True):
        u = side - tangent * (side @ tangent)
        u /= np.linalg.norm(u)
        v = np.cross(tangent, u)
        thin = 1.0 if flat is None else 0.5
        rings.append(point + radius * (thin * np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v))
        outwards.append(np.cos(angles)[:, None] * u + thin * np.sin(angles)[:, None] * v)
    vertices, normals = np.concatenate(rings), np.concatenate(outwards)
    normals[:SIDES], normals[-SIDES:] = -tangents[0], tangents[-1]
    ring = np.arange(SIDES)
    quads = [(i * SIDES + ring, i * SIDES + (ring + 1) % SIDES) for i in range(len(line))]
    faces = [np.stack(corners, -1) for (a, b), (c, d) in pairwise(quads) for corners in ((a, b, c), (b, d, c))]
    return (
        vertices,
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        np.concatenate(faces).astype(np.int32),
        np.tile(np.array(colour, np.float32), (len(vertices), 1)),
    )


def shaft(start: np.ndarray, back: np.ndarray, radius: float) -> Part:
    """A straight dark tube of 100 mm, in short pieces because the renderer leaves out triangles that reach behind the camera."""
    return tube(start + np.linspace(0, 100, 41)[:, None] * back, np.full(41, radius), DARK)


def direction(x: float, y: float, z: float) -> np.ndarray:
    return np.array([x, y, z]) / np.sqrt(x * x + y * y + z * z)


def join(parts: list[Part], label: int) -> Tool:
    offsets = np.cumsum([0] + [len(p[0]) for p in parts[:-1]])
    triangles = np.concatenate([p[2] + o for p, o in zip(parts, offsets, strict=True)]).astype(np.int32)
    vertices, normals, colours = (np.concatenate([p[i] for p in parts]) for i in (0, 1, 3))
    return Tool(vertices, normals, triangles, colours, label)


def grasper(tip: np.ndarray, back: np.ndarray, opening: float, label: int) -> Tool:
    """A grasper whose shaft leaves along `back`; its jaws open by `opening` radians each."""
    wrist = tip + 15.0 * back
    spread = np.cross(back, direction(0.2, 0.7, -0.7))
    spread /= np.linalg.norm(spread)
    parts = [shaft(wrist + 4 * back, back, 2.5)]
    parts.append(tube(np.stack([wrist - 1.0 * back, wrist + 1 * back, wrist + 5 * back]), np.array([1.5, 2.1, 2.3]), METAL))
    for sign in (-1.0, 1.0):
        u = np.linspace(0, 1, 7)[:, None]
        bow = np.sin(np.pi * u) * 0.9 + u * np.tan(opening) * 7.5
        line = wrist - 15.0 * u * back + sign * bow * spread
        parts.append(tube(line, np.linspace(1.5, 1.05, 7), METAL, flat=spread))
    return join(parts, label)


def hook(tip: np.ndarray, back: np.ndarray, label: int) -> Tool:
    """An electrocautery hook whose foot is bent towards the tissue."""
    foot = direction(0.25, -0.35, 0.90)
    heel = tip - 3.6 * foot
    t = np.linspace(0, 1, 6)[:, None]
    bend = (1 - t) ** 2 * heel + 2 * t * (1 - t) * (heel - 0.8 * foot) + t**2 * (heel + 1.6 * back)
    line = np.concatenate([tip[None], bend, (heel + 11 * back)[None]])
    parts = [
        tube(line, np.linspace(0.62, 0.8, len(line)), METAL),
        tube(np.stack([heel + 10 * back, heel + 14 * back]), np.array([1.6, 2.0]), CERAMIC),
        shaft(heel + 13.5 * back, back, 2.4),
    ]
    return join(parts, label)
