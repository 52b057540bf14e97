"""The tissue at rest: its shape, which organ lies where, and how each organ looks.

Material coordinates are a = z_ref · (x/z, y/z) of the reference camera, in mm. The surface at rest has one depth for each a, so every point
of it is seen at frame 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from degense.engine.data.synthetic.paint import (
    CHANGE_START,
    CHANGE_STRENGTH,
    SLOPE_X,
    SLOPE_Y,
    WETNESS,
    distance_to_path,
    dome_depth,
    finer_grid,
    linear,
    shade_creases,
    smoothstep,
)
from degense.engine.data.synthetic.texture import Sheet, fractal, mesh_and_texture, noise, slope, vessels

REFERENCE_DEPTH = 90.0  # mm: there, one unit of material coordinates is one mm across the view

CLASSES = (
    "abdominal wall",
    "liver",
    "gallbladder",
    "fat",
    "connective tissue",
    "charred tissue",
    "grasper",
    "L-hook electrocautery",
)
WALL, LIVER, GALLBLADDER, FAT, CONNECTIVE, CHARRED, GRASPER, HOOK = range(len(CLASSES))

# sRGB of each tissue: main tone, second tone, vessels; then vessel strength, relief (mm), wetness
LOOKS = {
    WALL: ((214, 132, 106), (176, 88, 74), (146, 40, 42), 0.55, 0.12, 0.35),
    LIVER: ((116, 44, 42), (86, 30, 33), (146, 66, 60), 0.30, 0.045, 0.85),
    GALLBLADDER: ((240, 206, 158), (214, 170, 136), (150, 46, 52), 0.75, 0.028, 1.00),
    FAT: ((242, 196, 112), (222, 156, 78), (184, 70, 54), 0.40, 0.20, 0.60),
    CONNECTIVE: ((228, 180, 166), (198, 122, 112), (160, 52, 54), 0.50, 0.10, 0.80),
}


@dataclass(frozen=True)
class Anatomy:
    """The surface at rest and what is painted on it."""

    mesh: Sheet  # grid of the surface's vertices
    rest: np.ndarray  # float64 [Hm, Wm, 3]; vertices at frame 0, mm, camera frame of frame 0
    #: float32 [Ht, Wt, 8]; on a finer grid of the same rectangle: linear RGB, slope of the fine relief (2), wetness, start of charring
    #: (clip time in [0, 1]) and its final strength in [0, 1].
    texture: np.ndarray
    labels: np.ndarray  # uint8 [Ht, Wt]; organ of each texture point, as if nothing were charred
    grasp: np.ndarray  # float64 [2]; material coordinates of the place that the grasper holds
    burn: np.ndarray  # float64 [k, 2]; path of the hook's tip, material coordinates

    def at_rest(self, a: np.ndarray) -> np.ndarray:
        """Surface points [k, 3] at material coordinates [k, 2] at frame 0, mm."""
        cell = (a - [self.mesh.x[0], self.mesh.y[0]]) / self.mesh.step
        maps = cell.astype(np.float32)
        return np.stack([cv2.remap(np.ascontiguousarray(self.rest[..., i]), maps[None], None, cv2.INTER_LINEAR)[0] for i in range(3)], -1)


def build_anatomy(rng: np.random.Generator, half: tuple[float, float], cells: int, finer: int, burning: tuple[float, float]) -> Anatomy:
    """A gallbladder between liver, fat and abdominal wall; `rng` varies shapes, places and texture.

    `half` is the half extent in x and y, material mm; `cells` mesh cells lie across the width and `finer` texture points along a cell.
    `burning` are the clip times in [0, 1] at which the hook begins and ends its path.
    """
    mesh, sheet = mesh_and_texture(half, cells, finer)

    jitter = rng.uniform(-2.5, 2.5, (6, 2))
    fundus, neck = np.array([15.0, -13.0]) + jitter[0], np.array([-19.0, 15.0]) + 0.6 * jitter[1]
    bulge = 0.5 * (fundus + neck) + np.array([3.0, 4.0]) + 0.5 * jitter[2]
    t = np.linspace(0, 1, 9)[:, None]
    axis = (1 - t) ** 2 * fundus + 2 * t * (1 - t) * bulge + t**2 * neck
    aside = np.array([-0.64, -0.77])
    burn = neck + np.array([-3.0, -6.5]) + np.linspace(-0.35, 1, 7)[:, None] * np.array([8.5, -5.5]) + aside * 1.0

    warp = [3.0 * noise(mesh, rng, 22.0) for _ in range(2)]
    swell = fractal(mesh, rng, 26.0, 3)
    heights = _organ_depths(mesh, axis, warp, swell, jitter)
    depth = -2.0 * np.log(np.exp(-(heights - 60) / 2.0).sum(0)) + 60
    x, y = mesh.points
    rest = np.stack([x / REFERENCE_DEPTH * depth, y / REFERENCE_DEPTH * depth, depth], -1)

    size = sheet.shape[::-1]
    upsampled = np.stack([finer_grid(h.astype(np.float32), finer, size) for h in heights])
    labels = np.argmin(upsampled, axis=0).astype(np.uint8)
    texture = _paint(sheet, rng, upsampled, finer_grid(depth.astype(np.float32), finer, size))
    texture[..., CHANGE_START], texture[..., CHANGE_STRENGTH] = _char(sheet, rng, burn, burning)
    return Anatomy(mesh, rest, texture, labels, axis[1], burn)


def _organ_depths(mesh: Sheet, axis: np.ndarray, warp: list[np.ndarray], swell: np.ndarray, jitter: np.ndarray) -> np.ndarray:
    """Depth of each tissue's own surface, mm, float64 [5, H, W], in the order of CLASSES; the nearest one is seen."""
    x, y = mesh.points
    wx, wy = x + warp[0], y + warp[1]
    wall = 113 - 0.10 * (wx + wy) + 1.5 * swell
    dome = partial(dome_depth, wx, wy)
    liver = np.minimum(
        dome(np.array([-34, -20]) + jitter[3], (46, 34), 0.45, 112, 25),
        dome(np.array([40, 16]) + jitter[4], (24, 34), -0.35, 112, 26),
    )
    distance, along = distance_to_path(x + 0.4 * warp[0], y + 0.4 * warp[1], axis)
    radius = 13.0 * (1 - along) ** 0.55 + 5.5
    gallbladder = 94 - (9 + 11 * (radius - 5.5) / 13) * (1 - (distance / radius) ** 2) + 0.3 * swell
    lobes = 2.2 * np.abs(swell) ** 0.8
    fat = dome(np.array([6, 44]) + jitter[5], (44, 25), 0.1, 108, 22) - lobes + 1.5
    bridge, along_bridge = distance_to_path(wx, wy, axis[4:] + np.array([-4.5, -6.0]))
    connective = 97.0 - 4 * (1 - (bridge / 9.0) ** 2) + 0.8 * swell - 1.0 * along_bridge
    return np.stack([wall, liver, gallbladder, fat, connective]).astype(np.float64)


def _paint(sheet: Sheet, rng: np.random.Generator, depths: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Texture channels RED to WETNESS, float32 [H, W, 8]; the two of charring stay 0."""
    blend = np.exp(-(depths - depths.min(0)) / 0.5)
    blend /= blend.sum(0)
    patches, grain, speckle = fractal(sheet, rng, 14.0, 4), fractal(sheet, rng, 2.4, 3), noise(sheet, rng, 0.7)
    nets = {
        WALL: vessels(sheet, rng, 26, 0.45, 0.75),
        LIVER: vessels(sheet, rng, 40, 0.30, 0.6),
        GALLBLADDER: vessels(sheet, rng, 52, 0.30, 0.66),
        FAT: vessels(sheet, rng, 30, 0.30, 0.6),
        CONNECTIVE: vessels(sheet, rng, 60, 0.28, 0.8),
    }
    lobules = np.exp(-((noise(sheet, rng, 4.5) / 0.16) ** 2)) * 0.8
    fibres = noise(Sheet(sheet.x * 0.25 + sheet.x.mean(), sheet.y), rng, 0.9)
    out = np.zeros((*sheet.shape, 8), np.float32)
    relief = np.zeros(sheet.shape, np.float32)
    for tissue, (main, second, vessel, strength, rough, wet) in LOOKS.items():
        tone = smoothstep(0.5 + 0.4 * patches + 0.16 * grain)[..., None]
        colour = linear(main) * (1 - tone) + linear(second) * tone
        colour = colour * np.exp(0.06 * grain + 0.03 * speckle)[..., None]
        bumps = 0.9 * grain + 0.4 * speckle
        if tissue == LIVER:
            colour = colour * np.exp(0.09 * speckle)[..., None]
        if tissue == FAT:
            colour = colour * (1 - 0.45 * lobules[..., None] * np.array([0.6, 0.9, 1.0]))
            bumps = bumps - 1.2 * lobules
        if tissue in (CONNECTIVE, WALL):
            colour = colour * np.exp((0.20 if tissue == CONNECTIVE else 0.08) * fibres)[..., None]
            bumps = bumps + 0.6 * fibres
        net = strength * nets[tissue][..., None]
        colour = colour * (1 - net) + linear(vessel) * net
        out[..., :3] += blend[tissue][..., None] * colour
        out[..., WETNESS] += blend[tissue] * wet
        relief += blend[tissue] * rough * bumps
    shade_creases(out, depth, sheet.step)
    out[..., SLOPE_X : SLOPE_Y + 1] = slope(relief, sheet.step)
    return out


def _char(sheet: Sheet, rng: np.random.Generator, burn: np.ndarray, burning: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """When each point begins to char (clip time) and how far it gets (0 to 1)."""
    x, y = sheet.points
    distance, along = distance_to_path(x, y, burn)
    ragged = CHAR_RADIUS * (0.74 + 0.13 * np.clip(fractal(sheet, rng, 3.0, 3), -2, 2))
    start = burning[0] + (burning[1] - burning[0]) * along + 0.06 * distance / CHAR_RADIUS
    return start, smoothstep((1 - distance / ragged) / 0.6)


CHAR_RADIUS = 4.2  # mm of material; charring ends within it
