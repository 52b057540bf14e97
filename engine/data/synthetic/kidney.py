"""The tissue of the kind "bleeding" at rest: a kidney under its cover, fat, bowel, abdominal wall, a line to cut along and a bed beneath.

Material coordinates are as in `anatomy`. One row of the mesh follows the line of the cut, so that tissue can part there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from degense.engine.data.synthetic.anatomy import REFERENCE_DEPTH
from degense.engine.data.synthetic.paint import (
    CHANGE_START,
    CHANGE_STRENGTH,
    SLOPE_X,
    SLOPE_Y,
    WETNESS,
    WIPED,
    distance_to_path,
    dome_depth,
    finer_grid,
    linear,
    shade_creases,
    smoothstep,
)
from degense.engine.data.synthetic.stage import Patch
from degense.engine.data.synthetic.texture import Sheet, fractal, mesh_and_texture, noise, slope, vessels

CLASSES = (
    "covered kidney",
    "kidney parenchyma",
    "small intestine",
    "fat",
    "abdominal wall",
    "blood",
    "scissors",
    "suction instrument",
)
COVERED, PARENCHYMA, BOWEL, FAT, WALL, BLOOD, SCISSORS, SUCTION = range(len(CLASSES))

# sRGB of each tissue: main tone, second tone, vessels; then number, radius (mm) and strength of vessels, relief (mm), wetness
LOOKS = {
    COVERED: ((226, 176, 138), (198, 126, 104), (150, 44, 48), 46, 0.34, 0.60, 0.06, 0.75),
    PARENCHYMA: ((142, 62, 50), (104, 38, 38), (92, 26, 30), 24, 0.26, 0.35, 0.045, 0.95),
    BOWEL: ((230, 164, 146), (208, 128, 116), (170, 58, 62), 60, 0.24, 0.65, 0.035, 1.00),
    FAT: ((242, 200, 112), (224, 160, 80), (184, 70, 54), 26, 0.30, 0.40, 0.20, 0.60),
    WALL: ((208, 128, 104), (172, 86, 74), (146, 40, 42), 24, 0.45, 0.55, 0.12, 0.35),
}
CUT = (-15.0, 17.0)  # mm, first and last x of the cut
BED_DEPTH = 2.6  # mm from the surface down to the bed that the cut lays open
BED_HALF = 10.0  # mm, half height of the bed


@dataclass(frozen=True)
class Kidney:
    """The surface at rest, in two halves that meet along the cut, and the bed beneath it."""

    patches: list[Patch]  # above the cut, below it, and the bed
    points: list[np.ndarray]  # list of float64 [h, w, 2]; material coordinates of their vertices
    cut: np.ndarray  # float64 [w, 2]; material coordinates of the shared row of vertices
    source: np.ndarray  # float64 [2]; where the blood wells up
    bowel: np.ndarray  # float64 [k, 2]; centre line of the bowel
    texture: np.ndarray  # of surface and bed, the bed's below the surface's
    labels: np.ndarray  # of surface and bed, the bed's below the surface's


def build_kidney(
    rng: np.random.Generator, half: tuple[float, float], cells: int, finer: int, bleeding: tuple[float, float], sucking: tuple[float, float]
) -> Kidney:
    """A kidney; `rng` varies shapes, places and texture.

    Parameters
    ----------
    half : (float, float)
        Half extent in x and y, material mm.
    cells, finer : int
        Mesh cells across the width, texture points along a cell.
    bleeding, sucking : (float, float)
        Clip times in [0, 1] from the first to the last place that blood reaches, and between which suction takes it away.
    """
    mesh, sheet = mesh_and_texture(half, cells, finer)
    step, rows = 2 * half[0] / cells, len(mesh.y) // 2
    jitter = rng.uniform(-2.5, 2.5, (6, 2))
    bowel = np.array([(-64, 28), (-44, 19), (-27, 30), (-8, 37), (18, 34), (40, 42), (64, 38)], float) + jitter[0]
    heights = _organ_depths(mesh, rng, bowel, jitter)
    depth = -1.6 * np.log(np.exp(-(heights - 60) / 1.6).sum(0)) + 60

    size = sheet.shape[::-1]
    upsampled = np.stack([finer_grid(h.astype(np.float32), finer, size) for h in heights])
    labels = np.argmin(upsampled, axis=0).astype(np.uint8)
    surface, bed = _paint(sheet, rng, upsampled, finer_grid(depth.astype(np.float32), finer, size))

    wobble, phase = rng.uniform(2.2, 3.2), rng.uniform(0, 2 * np.pi)
    line = wobble * np.sin(mesh.x / 9.5 + phase) * np.exp(-((mesh.x / 34.0) ** 4))
    x, y = mesh.points
    bent = np.stack([x, y + line * np.exp(-((y / 13.0) ** 2))], -1)
    cut = np.stack([mesh.x, line], -1)
    source = np.array([8.0, np.interp(8.0, mesh.x, line)]) + jitter[1] * np.array([0.6, 0.0])
    for texture, quicker in ((surface, 1.0), (bed, 0.45)):
        _pool(texture, sheet, rng, source, bleeding, sucking, quicker)

    reach = int(np.ceil(BED_HALF / step))
    parts = [bent[: rows + 1], bent[rows:], bent[rows - reach : rows + reach + 1]]
    below = [np.zeros(2), np.zeros(2), np.array([0.0, len(sheet.y)])]
    patches = []
    for number, (points, down) in enumerate(zip(parts, below, strict=True)):
        cell = ((points - [mesh.x[0], mesh.y[0]]) / step).astype(np.float32)
        z = cv2.remap(depth.astype(np.float32), cell, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
        if number == 2:
            z = z + BED_DEPTH
        patches.append(Patch(np.concatenate([points / REFERENCE_DEPTH * z[..., None], z[..., None]], -1), cell * float(finer) + down))
    organs = np.concatenate([labels, np.full_like(labels, PARENCHYMA)])
    return Kidney(patches, parts, cut, source, bowel, np.concatenate([surface, bed]), organs)


def _organ_depths(mesh: Sheet, rng: np.random.Generator, bowel: np.ndarray, jitter: np.ndarray) -> np.ndarray:
    """Depth of each tissue's own surface, mm, float64 [5, H, W], in the order of CLASSES; the nearest one is seen."""
    x, y = mesh.points
    warp = [2.6 * noise(mesh, rng, 22.0) for _ in range(2)]
    swell = fractal(mesh, rng, 26.0, 3)
    wx, wy = x + warp[0], y + warp[1]
    dome = partial(dome_depth, wx, wy)
    covered = dome(np.array([0, 0]) + 0.4 * jitter[2], (42, 27), -0.16, 106, 23) + 0.4 * swell
    parenchyma = dome(np.array([38, -9]) + jitter[3], (20, 25), 0.25, 106, 22)
    distance, along = distance_to_path(x + 0.5 * warp[0], y + 0.5 * warp[1], bowel)
    folds = 0.35 * np.cos(along * 150)
    loops = 96 - (13 + 1.5 * np.sin(9 * along)) * (1 - (distance / 11.5) ** 2) + folds * np.exp(-((distance / 9) ** 2))
    lobes = 2.2 * np.abs(fractal(mesh, rng, 18.0, 2)) ** 0.8
    fat = np.minimum(
        dome(np.array([-42, -26]) + jitter[4], (34, 26), 0.5, 108, 24), dome(np.array([8, -50]) + jitter[5], (40, 17), 0.0, 108, 24)
    )
    wall = 112 - 0.08 * wx + 0.06 * wy + 1.5 * swell
    return np.stack([covered, parenchyma, loops, fat - lobes + 1.5, wall]).astype(np.float64)


def _paint(sheet: Sheet, rng: np.random.Generator, depths: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Texture of the surface and of the bed, float32 [H, W, 9] each, without blood."""
    blend = np.exp(-(depths - depths.min(0)) / 0.5)
    blend /= blend.sum(0)
    patches, grain, speckle = fractal(sheet, rng, 14.0, 4), fractal(sheet, rng, 2.4, 3), noise(sheet, rng, 0.7)
    lobules = np.exp(-((noise(sheet, rng, 4.5) / 0.16) ** 2)) * 0.8
    fibres = noise(Sheet(sheet.x * 0.25, sheet.y), rng, 0.8)
    out, bed = np.zeros((*sheet.shape, 9), np.float32), np.zeros((*sheet.shape, 9), np.float32)
    relief = np.zeros(sheet.shape, np.float32)
    for tissue, (main, second, vessel, trunks, radius, strength, rough, wet) in LOOKS.items():
        tone = smoothstep(0.5 + 0.4 * patches + 0.16 * grain)[..., None]
        colour = linear(main) * (1 - tone) + linear(second) * tone
        colour = colour * np.exp((0.08 if tissue == PARENCHYMA else 0.05) * grain + 0.04 * speckle)[..., None]
        bumps = 0.9 * grain + 0.4 * speckle
        if tissue == FAT:
            colour = colour * (1 - 0.45 * lobules[..., None] * np.array([0.6, 0.9, 1.0]))
            bumps = bumps - 1.2 * lobules
        if tissue in (COVERED, WALL):
            colour = colour * np.exp((0.12 if tissue == COVERED else 0.08) * fibres)[..., None]
            bumps = bumps + 0.5 * fibres
        net = strength * vessels(sheet, rng, trunks, radius, 0.7)[..., None]
        colour = colour * (1 - net) + linear(vessel) * net
        out[..., :3] += blend[tissue][..., None] * colour
        out[..., WETNESS] += blend[tissue] * wet
        relief += blend[tissue] * rough * bumps
        if tissue == PARENCHYMA:
            bed[..., :3] = 0.7 * colour
    shade_creases(out, depth, sheet.step)
    bed[..., WETNESS] = LOOKS[PARENCHYMA][-1]
    out[..., SLOPE_X : SLOPE_Y + 1] = slope(relief, sheet.step)
    bed[..., SLOPE_X : SLOPE_Y + 1] = slope(0.12 * grain, sheet.step)
    return out, bed


def _pool(
    texture: np.ndarray,
    sheet: Sheet,
    rng: np.random.Generator,
    source: np.ndarray,
    bleeding: tuple[float, float],
    sucking: tuple[float, float],
    quicker: float,
) -> None:
    """Write when blood reaches each point, how thick it gets and when it is sucked away; in a bed it spreads `quicker` times as slowly."""
    x, y = sheet.points
    ragged = fractal(sheet, rng, 5.0, 3)
    across, down = x - source[0] + 0.12 * (y - source[1]), y - source[1]
    far = np.hypot(across / 14.0, down / np.where(down > 0, 24.0, 6.0)) * quicker + 0.07 * ragged
    arrival = bleeding[0] + (bleeding[1] - bleeding[0]) * np.clip(far, 0, 1) ** 1.4
    texture[..., CHANGE_START] = arrival
    texture[..., CHANGE_STRENGTH] = smoothstep((1.0 - far) / 0.16) * (0.82 + 0.18 * np.clip(1.3 - far, 0, 1))
    away, along = distance_to_path(x, y, suction_path(source))
    edge = smoothstep((away / (6.2 + 0.8 * ragged) - 0.75) / 0.3)
    texture[..., WIPED] = sucking[0] + (sucking[1] - sucking[0]) * along + 0.03 * away / 6.0 + 2.0 * edge


def suction_path(source: np.ndarray) -> np.ndarray:
    """Where the tip of the suction tube goes, material coordinates [k, 2]."""
    return source + np.array([(5.0, 13.0), (0.0, 9.0), (-4.0, 11.0), (-2.0, 5.0), (2.0, 2.5)])
