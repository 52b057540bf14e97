"""The tissue of a surgery of the family at rest: its surface, and what is painted on it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from degense.engine.data.synthetic.anatomy import REFERENCE_DEPTH
from degense.engine.data.synthetic.paint import (
    CHANGE_KIND,
    CHANGE_START,
    CHANGE_STRENGTH,
    CHANGE_TIME,
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
from degense.engine.data.synthetic.render import BLEEDS, CHARS
from degense.engine.data.synthetic.stage import Patch
from degense.engine.data.synthetic.texture import Sheet, fractal, mesh_and_texture, noise, slope, vessels
from degense.engine.research.surgeries.plan import LOOKS, SurgeryPlan

CHANNELS = CHANGE_TIME + 1
FINER = 3  # texture points along a mesh cell
UNION = 1.4  # mm over which organs melt into one another
BED_DEPTH, BED_HALF = 2.6, 10.0  # mm from the surface down to the bed that a cut lays open, and half its height


@dataclass(frozen=True)
class Tissue:
    """The surface at rest, in one patch, or, where it is cut, in two that meet along the cut and the bed beneath.

    Attributes
    ----------
    patches : list of Patch
    points : list of float64 [h, w, 2]
        Material coordinates of their vertices.
    sides : tuple of float
        Of each patch, where it goes when the cut opens: −1 up, 1 down, 0 stays.
    texture : float32 [Ht, Wt, CHANNELS]
    labels : uint8 [Ht, Wt]
    """

    patches: list[Patch]
    points: list[np.ndarray]
    sides: tuple[float, ...]
    texture: np.ndarray
    labels: np.ndarray


def build_tissue(plan: SurgeryPlan, half: tuple[float, float], cells: int, rng: np.random.Generator) -> Tissue:
    """Tissue within ±`half` material mm, with `cells` mesh cells across."""
    mesh, sheet = mesh_and_texture(half, cells, FINER)
    heights = _organ_depths(plan, mesh, rng)
    depth = -UNION * np.log(np.exp(-(heights - 60) / UNION).sum(0)) + 60
    upsampled = np.stack([finer_grid(h.astype(np.float32), FINER, sheet.shape[::-1]) for h in heights])
    nearest = np.argmin(upsampled, axis=0)
    label_of = np.array([plan.classes.index(organ.tissue) for organ in plan.organs], np.uint8)
    texture, relief = _paint(plan, sheet, upsampled, rng)
    shade_creases(texture, finer_grid(depth.astype(np.float32), FINER, sheet.shape[::-1]), sheet.step)
    texture[..., SLOPE_X : SLOPE_Y + 1] = slope(relief, sheet.step)
    _change(plan, sheet, texture, rng)
    labels = label_of[nearest]
    if plan.cut is None:
        rows, columns = mesh.shape
        texels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1) * float(FINER)
        points = np.stack(mesh.points, -1)
        return Tissue([Patch(_raised(points, depth), texels)], [points], (0.0,), texture, labels)
    return _cut_open(plan, mesh, depth, texture, labels, rng)


def _raised(points: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Vertices, mm, of material points [h, w, 2] at a depth [h, w]."""
    return np.concatenate([points / REFERENCE_DEPTH * depth[..., None], depth[..., None]], -1).astype(np.float64)


def _cut_open(
    plan: SurgeryPlan, mesh: Sheet, depth: np.ndarray, texture: np.ndarray, labels: np.ndarray, rng: np.random.Generator
) -> Tissue:
    """The surface in two halves that meet along the cut, one row of whose vertices follows it, and the bed beneath."""
    assert plan.cut is not None
    x, y = mesh.points
    wobble, phase = rng.uniform(1.0, 2.6), rng.uniform(0, 2 * np.pi)
    row = int(np.abs(mesh.y - plan.cut.y).argmin())
    line = wobble * np.sin(mesh.x / 9.5 + phase) * np.exp(-((mesh.x / 34.0) ** 4))
    bent = np.stack([x, y + line * np.exp(-(((y - mesh.y[row]) / 13.0) ** 2))], -1)
    reach = min(int(np.ceil(BED_HALF / mesh.step)), row, len(mesh.y) - 1 - row)
    parts = [bent[: row + 1], bent[row:], bent[row - reach : row + reach + 1]]
    height = len(texture)
    patches = []
    for number, points in enumerate(parts):
        cell = ((points - [mesh.x[0], mesh.y[0]]) / mesh.step).astype(np.float32)
        z = cv2.remap(depth.astype(np.float32), cell, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
        bed = number == 2
        patches.append(Patch(_raised(points, z + BED_DEPTH * bed), cell * float(FINER) + np.array([0.0, height * bed])))
    bed_texture = texture.copy()
    bed_texture[..., :3] *= np.array([0.75, 0.45, 0.45], np.float32)
    bed_texture[..., CHANGE_STRENGTH] = 0
    return Tissue(patches, parts, (-1.0, 1.0, 0.0), np.concatenate([texture, bed_texture]), np.concatenate([labels, labels]))


def _organ_depths(plan: SurgeryPlan, mesh: Sheet, rng: np.random.Generator) -> np.ndarray:
    """Depth of each organ's own surface, mm, float64 [n, H, W]; the nearest one is seen."""
    x, y = mesh.points
    wx, wy = x + 2.6 * noise(mesh, rng, 22.0), y + 2.6 * noise(mesh, rng, 22.0)
    swell = fractal(mesh, rng, 26.0, 3)
    found = []
    for organ in plan.organs:
        bumps = swell if organ.tissue != "fat" else 2.2 * np.abs(swell) ** 0.8
        if organ.shape == "ground":
            found.append(110 + organ.angle * (wx + 0.6 * wy) + 1.5 * swell)
        elif organ.shape == "dome":
            found.append(dome_depth(wx, wy, np.array(organ.points[0]), organ.radii, organ.angle, 108, organ.height) + 0.5 * bumps)
        else:
            distance, along = distance_to_path(x + 0.5 * (wx - x), y + 0.5 * (wy - y), np.array(organ.points))
            radius = organ.radii[0] * (1 - organ.radii[1] * np.abs(2 * along - 1))
            folds = 0.3 * np.cos(along * 120) if organ.tissue == "small intestine" else 0.0
            found.append(103 - organ.height * (1 - (distance / radius) ** 2) + folds * np.exp(-((distance / radius) ** 2)))
    return np.stack(found).astype(np.float64)


def _paint(plan: SurgeryPlan, sheet: Sheet, depths: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Texture without slopes and changes, float32 [H, W, CHANNELS], and the fine relief, mm, [H, W]."""
    blend = np.exp(-(depths - depths.min(0)) / 0.5)
    blend /= blend.sum(0)
    patches, grain, speckle = fractal(sheet, rng, 14.0, 4), fractal(sheet, rng, 2.4, 3), noise(sheet, rng, 0.7)
    lobules = np.exp(-((noise(sheet, rng, 4.5) / 0.16) ** 2)) * 0.8
    fibres = noise(Sheet(sheet.x * 0.25, sheet.y), rng, 0.9)
    out, relief = np.zeros((*sheet.shape, CHANNELS), np.float32), np.zeros(sheet.shape, np.float32)
    for organ, share in zip(plan.organs, blend, strict=True):
        main, second, vessel, trunks, rough, wet = LOOKS[organ.tissue]
        tone = smoothstep(0.5 + plan.texture * (0.4 * patches + 0.16 * grain))[..., None]
        colour = linear(main) * (1 - tone) + linear(second) * tone
        colour = colour * np.array(organ.tone, np.float32) * np.exp(plan.texture * (0.09 * grain + 0.05 * speckle))[..., None]
        bumps = 0.9 * grain + 0.4 * speckle
        if organ.tissue == "fat":
            colour = colour * (1 - 0.45 * plan.texture * lobules[..., None] * np.array([0.6, 0.9, 1.0]))
            bumps = bumps - 1.2 * lobules
        if organ.tissue in ("connective tissue", "abdominal wall", "covered kidney"):
            colour = colour * np.exp(0.12 * plan.texture * fibres)[..., None]
            bumps = bumps + 0.5 * fibres
        number = round(trunks * plan.vessels)
        if number:
            net = 0.55 * min(1.0, 0.3 + plan.texture) * vessels(sheet, rng, number, 0.32, 0.7)[..., None]
            colour = colour * (1 - net) + linear(vessel) * net
        out[..., :3] += share[..., None] * colour
        out[..., WETNESS] += share * wet
        relief += share * (0.25 + 0.75 * plan.texture) * rough * bumps
    return out, relief


def _change(plan: SurgeryPlan, sheet: Sheet, texture: np.ndarray, rng: np.random.Generator) -> None:
    """Write when each point begins to change its look, how far it gets and how long it takes; of several changes the strongest counts."""
    x, y = sheet.points
    ragged = np.clip(fractal(sheet, rng, 3.0, 3), -2, 2)
    texture[..., CHANGE_TIME], texture[..., WIPED] = 1.0, 9.0
    for burn in plan.burns:
        distance, along = _to_path(x, y, burn.path)
        far = distance / (burn.radius * (1 + 0.1 * ragged))
        strength = burn.darkness * smoothstep((1 - far) / burn.edge)
        front = 0.25 if len(set(burn.path)) > 1 else 1.0  # a spot grows from its middle, a line along itself
        start = burn.begins + burn.lasts * ((1 - front) * along + front * np.clip(far, 0, 1))
        _stronger(texture, strength, start, burn.rise, CHARS)
    if (blood := plan.blood) is not None:
        across, down = x - blood.source[0], y - blood.source[1]
        far = np.hypot(across / blood.radius, down / np.where(down > 0, 1.6 * blood.radius, 0.5 * blood.radius)) + 0.05 * ragged
        _stronger(texture, smoothstep((1 - far) / 0.2), blood.begins + blood.lasts * np.clip(far, 0, 1) ** 1.4, 0.06, BLEEDS)
        if blood.suction:
            wiped = np.hypot(across, down) / blood.radius
            texture[..., WIPED] = blood.begins + blood.lasts + 0.15 * wiped + 2.0 * smoothstep((wiped - 0.7) / 0.2)


def _stronger(texture: np.ndarray, strength: np.ndarray, start: np.ndarray, rise: float, kind: int) -> None:
    wins = strength > texture[..., CHANGE_STRENGTH]
    for channel, value in ((CHANGE_START, start), (CHANGE_STRENGTH, strength), (CHANGE_TIME, rise), (CHANGE_KIND, float(kind))):
        texture[..., channel] = np.where(wins, value, texture[..., channel])


def _to_path(x: np.ndarray, y: np.ndarray, path: tuple[tuple[float, float], ...]) -> tuple[np.ndarray, np.ndarray]:
    """`distance_to_path` for a path that may be a single place."""
    points = np.array(path)
    if len({tuple(point) for point in path}) == 1:
        return np.hypot(x - points[0, 0], y - points[0, 1]), np.zeros_like(x)
    return distance_to_path(x, y, points)
