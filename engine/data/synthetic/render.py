"""Draws triangle meshes with a z-buffer and shades them as an endoscope sees them: one light, at the camera.

Every pixel is cut into 3 × 3 samples. Colour is their mean; depth, label, displacement and change are those of the middle sample,
which lies exactly on the pixel's centre. All of them are interpolated on the same triangle, so they agree with each other to rounding.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

import degense.engine.threads  # noqa: F401 - where compiled kernels are kept
from degense.engine.data.synthetic.paint import (
    BLUE,
    CHANGE_KIND,
    CHANGE_START,
    CHANGE_STRENGTH,
    CHANGE_TIME,
    GREEN,
    RED,
    SLOPE_X,
    SLOPE_Y,
    WETNESS,
    WIPED,
)

CHARS, BLEEDS = 0, 1  # how tissue changes its look

SAMPLES = 3
NEAREST = 8.0  # mm: triangles that come nearer to the camera are not drawn
LIT_DEPTH = 80.0  # mm: a white surface that faces the camera from here is drawn just white, where the exposure is 1
CHANGE_BEGUN = 0.05
CHANGE_CLASS = 0.5  # tissue that has changed further than this bears the name of the change
WIPE_TIME, STAIN = 0.06, 0.2  # clip time that wiping a place takes, and the share of the blood that is left there


@njit(cache=True, nogil=True)
def cover(pixels: np.ndarray, z: np.ndarray, triangles: np.ndarray, inverse_depth: np.ndarray, owner: np.ndarray, first: int) -> None:
    """Enter triangles int32 [F, 3], numbered from `first`, in a z-buffer, which is changed in place.

    Vertices are projected to `pixels` float64 [V, 2] (samples) at depth `z` [V]. Of each sample `inverse_depth` float64 [h, w] is 1/z, 0
    where nothing is, and `owner` int32 [h, w] the number of its triangle.
    """
    height, width = owner.shape
    for f in range(triangles.shape[0]):
        a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        if min(z[a], z[b], z[c]) < NEAREST:
            continue
        ax, ay, bx, by, cx, cy = pixels[a, 0], pixels[a, 1], pixels[b, 0], pixels[b, 1], pixels[c, 0], pixels[c, 1]
        x0, x1 = max(0, math.ceil(min(ax, bx, cx) - 0.5)), min(width - 1, math.floor(max(ax, bx, cx) - 0.5))
        y0, y1 = max(0, math.ceil(min(ay, by, cy) - 0.5)), min(height - 1, math.floor(max(ay, by, cy) - 0.5))
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                px, py = x + 0.5, y + 0.5
                wa = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
                wb = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
                wc = 1.0 - wa - wb
                if wa >= 0.0 and wb >= 0.0 and wc >= 0.0:
                    near = wa / z[a] + wb / z[b] + wc / z[c]
                    if near > inverse_depth[y, x]:
                        inverse_depth[y, x] = near
                        owner[y, x] = first + f


class Mesh(NamedTuple):
    """All meshes as one, the tissue's first."""

    pixels: np.ndarray  # float64 [V, 2]; projected vertices, in samples
    z: np.ndarray  # float64 [V]
    triangles: np.ndarray  # int32 [F, 3]
    normals: np.ndarray  # float64 [V, 3]; in the camera's frame
    attributes: np.ndarray  # float64 [V, 5]; of tissue: texture x, y (in texels) and displacement; of tools: linear RGB
    tissue_triangles: int
    tool_labels: np.ndarray  # uint8 [F - tissue_triangles]; label of each triangle of a tool


class TissueSurface(NamedTuple):
    """How tissue looks at one clip time."""

    texture: np.ndarray  # float32 [Ht, Wt, 8, 9 or 11]; see `engine.data.synthetic.paint`
    organs: np.ndarray  # uint8 [Ht, Wt]; label of each texture point, as if nothing had changed
    axes: np.ndarray  # float64 [2, 3]; world x and y in the camera's frame: along them the relief tilts the normals
    change: int  # `CHARS` or `BLEEDS`
    changed_labels: np.ndarray  # uint8 [2]; of tissue that has changed, by how
    s: float  # clip time
    change_time: float  # clip time that the change takes at one place, where the texture does not say
    light: np.ndarray  # float64 [3]; power of the distance with which it falls, strength of highlights, exposure


class Shaded(NamedTuple):
    """Colour and truth of every pixel."""

    colour: np.ndarray  # float64 [H, W, 3], linear
    depth: np.ndarray  # float64 [H, W]; 0 where nothing is
    label: np.ndarray  # uint8 [H, W]; 255 where nothing is
    displacement: np.ndarray  # float64 [H, W, 3]; NaN where no tissue is
    change: np.ndarray  # float64 [H, W], in [0, 1]


@njit(cache=True, nogil=True)
def shade(owner: np.ndarray, mesh: Mesh, surface: TissueSurface, intrinsics: np.ndarray) -> Shaded:
    """Colour and truth of every pixel of `owner`, int32 [3H, 3W] from `cover`, −1 where nothing is; fx, fy, cx, cy in samples."""
    pixels, z, triangles, normals, attributes, tissue_triangles, tool_labels = mesh
    texture, organs, axes, change_kind, changed_labels, s, change_time, lamp = surface
    height, width = owner.shape[0] // SAMPLES, owner.shape[1] // SAMPLES
    colour = np.zeros((height, width, 3))
    depth = np.zeros((height, width))
    label = np.full((height, width), 255, np.uint8)
    displacement = np.full((height, width, 3), np.nan)
    change = np.zeros((height, width))
    weight = 1.0 / SAMPLES**2
    t, n, values, rgb = np.zeros(texture.shape[2]), np.zeros(3), np.zeros(5), np.zeros(3)
    for v in range(owner.shape[0]):
        for u in range(owner.shape[1]):
            f = owner[v, u]
            if f < 0:
                continue
            a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
            wa, wb, wc, distance = _weights(pixels, z, a, b, c, u + 0.5, v + 0.5)
            for i in range(5):
                values[i] = wa * attributes[a, i] + wb * attributes[b, i] + wc * attributes[c, i]
            for i in range(3):
                n[i] = wa * normals[a, i] + wb * normals[b, i] + wc * normals[c, i]
            centre = u % SAMPLES == SAMPLES // 2 and v % SAMPLES == SAMPLES // 2
            y, x = v // SAMPLES, u // SAMPLES
            if f < tissue_triangles:
                column, row = _sample(texture, values[0], values[1], t)
                kind, lasts = change_kind, change_time
                if texture.shape[2] > CHANGE_TIME:
                    kind, lasts = int(t[CHANGE_KIND] + 0.5), t[CHANGE_TIME]
                changed, wet, relief = _tissue(t, kind, s, lasts, rgb)
                tight = 70.0
                for i in range(3):
                    n[i] -= (t[SLOPE_X] * axes[0, i] + t[SLOPE_Y] * axes[1, i]) * relief
                if centre:
                    label[y, x] = changed_labels[kind] if changed > CHANGE_CLASS else organs[row, column]
                    for i in range(3):
                        displacement[y, x, i] = values[2 + i]
                    change[y, x] = changed
            else:
                for i in range(3):
                    rgb[i] = values[i]
                wet, tight = 1.6, 26.0
                if centre:
                    label[y, x] = tool_labels[f - tissue_triangles]
            if centre:
                depth[y, x] = distance
            # The light sits at the camera: its direction, the viewer's and the half vector are all the line of sight.
            lx, ly = (u + 0.5 - intrinsics[2]) / intrinsics[0], (v + 0.5 - intrinsics[3]) / intrinsics[1]
            reach = math.sqrt(lx * lx + ly * ly + 1.0)
            facing = abs(n[0] * lx + n[1] * ly + n[2]) / reach / math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
            light = lamp[2] * (LIT_DEPTH / (distance * reach)) ** lamp[0]
            gleam = lamp[1] * wet * (0.85 * facing ** (4 * tight) + 0.10 * facing**tight)
            for i in range(3):
                colour[y, x, i] += weight * min(light * (rgb[i] * facing + gleam), 1.0)
    return Shaded(colour, depth, label, displacement, change)


@njit(cache=True, nogil=True)
def _weights(pixels: np.ndarray, z: np.ndarray, a: int, b: int, c: int, px: float, py: float) -> tuple[float, float, float, float]:
    """Barycentric weights of the vertices a, b, c at a sample, correct in perspective, and its depth."""
    ax, ay, bx, by, cx, cy = pixels[a, 0], pixels[a, 1], pixels[b, 0], pixels[b, 1], pixels[c, 0], pixels[c, 1]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    wa = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
    wb = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
    wa, wb, wc = wa / z[a], wb / z[b], (1.0 - wa - wb) / z[c]
    distance = 1.0 / (wa + wb + wc)
    return wa * distance, wb * distance, wc * distance, distance


@njit(cache=True, nogil=True)
def _sample(texture: np.ndarray, x: float, y: float, t: np.ndarray) -> tuple[int, int]:
    """Bilinear sample of a texture, written to `t`; column and row of the nearest texel."""
    rows, columns = texture.shape[0], texture.shape[1]
    tx, ty = min(max(x, 0.0), columns - 1.001), min(max(y, 0.0), rows - 1.001)
    ix, iy = int(tx), int(ty)
    wx, wy = tx - ix, ty - iy
    for i in range(texture.shape[2]):
        top = texture[iy, ix, i] * (1 - wx) + texture[iy, ix + 1, i] * wx
        bottom = texture[iy + 1, ix, i] * (1 - wx) + texture[iy + 1, ix + 1, i] * wx
        t[i] = top * (1 - wy) + bottom * wy
    return int(tx + 0.5), int(ty + 0.5)


@njit(cache=True, nogil=True)
def _tissue(t: np.ndarray, change: int, s: float, change_time: float, rgb: np.ndarray) -> tuple[float, float, float]:
    """Colour of tissue with texture values `t`, written to `rgb`; how far it has changed, its wetness and the strength of its relief."""
    rise = min(max((s - t[CHANGE_START]) / change_time, 0.0), 1.0)
    changed = t[CHANGE_STRENGTH] * rise * rise * (3 - 2 * rise)
    if change == CHARS:
        _burn(t, changed, rgb)
        return changed, t[WETNESS] * (1 - 0.8 * changed), 0.9
    gone = min(max((s - t[WIPED]) / WIPE_TIME, 0.0), 1.0)
    changed *= 1 - (1 - STAIN) * gone * gone * (3 - 2 * gone)
    _bleed(t, changed, rgb)
    return changed, t[WETNESS] + changed * (1.3 - t[WETNESS]), 0.9 - 0.75 * changed


@njit(cache=True, nogil=True)
def _burn(t: np.ndarray, charred: float, rgb: np.ndarray) -> None:
    """Colour of tissue charred so far: first pale (proteins coagulate), then brown, then black."""
    pale, brown = min(charred / 0.25, 1.0), min(max((charred - 0.25) / 0.3, 0.0), 1.0)
    black = min(max((charred - 0.55) / 0.4, 0.0), 1.0)
    tone = 0.4 + 0.6 * (t[RED] + t[GREEN] + t[BLUE])
    for i in range(3):
        coagulated = (0.50, 0.36, 0.24)[i] * tone
        toasted = (0.115, 0.048, 0.020)[i] * tone
        burnt = (0.018, 0.012, 0.010)[i] * tone
        value = t[i] + 0.75 * pale * (coagulated - t[i])
        value += brown * (toasted - value)
        rgb[i] = value + black * (burnt - value)


@njit(cache=True, nogil=True)
def _bleed(t: np.ndarray, thickness: float, rgb: np.ndarray) -> None:
    """Colour of tissue under a film of blood, by Beer and Lambert: it swallows green and blue first and shines dark red when thick."""
    for i in range(3):
        through = math.exp(-(0.9, 5.5, 6.0)[i] * thickness)
        rgb[i] = t[i] * through + (0.13, 0.007, 0.006)[i] * (1 - through)
