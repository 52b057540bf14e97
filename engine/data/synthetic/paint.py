"""What the painters of tissue share: the texture's channels, colours, creases and distances."""

from __future__ import annotations

import cv2
import numpy as np

#: Channels of a texture: linear RGB, slope of the fine relief, wetness, clip time in [0, 1] at which the tissue begins to change its look,
#: how far it gets (0 to 1) and, where blood can be wiped away again, the clip time at which it is. Where places differ, also how the tissue
#: changes there (`render.CHARS` or `render.BLEEDS`) and the clip time that it takes.
RED, GREEN, BLUE, SLOPE_X, SLOPE_Y, WETNESS, CHANGE_START, CHANGE_STRENGTH, WIPED, CHANGE_KIND, CHANGE_TIME = range(11)


def smoothstep(x: np.ndarray | float) -> np.ndarray:
    """0 below 0, 1 above 1, with continuous slope."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def linear(srgb: tuple[int, int, int]) -> np.ndarray:
    """Linear RGB of an 8-bit sRGB colour, by the power law that the phantom's camera uses."""
    return (np.array(srgb, np.float32) / 255) ** 2.2


def finer_grid(values: np.ndarray, finer: int, size: tuple[int, int]) -> np.ndarray:
    """Mesh values [Hm, Wm] on the texture's grid: bilinear, with mesh points on texture points."""
    x, y = np.meshgrid(np.arange(size[0], dtype=np.float32) / finer, np.arange(size[1], dtype=np.float32) / finer)
    return cv2.remap(values, x, y, cv2.INTER_LINEAR)


def shade_creases(texture: np.ndarray, depth: np.ndarray, step: float) -> None:
    """Darken and redden a texture, in place, in the creases between organs: they lie in shade and collect a little blood."""
    hollow = np.clip((depth - cv2.GaussianBlur(depth, (0, 0), 2.2 / step)) / 1.6, 0, 1)[..., None]
    texture[..., :3] *= 1 - hollow * np.array([0.45, 0.68, 0.66], np.float32)


def dome_depth(
    x: np.ndarray, y: np.ndarray, centre: np.ndarray, radii: tuple[float, float], angle: float, base: float, height: float
) -> np.ndarray:
    """Depth of a dome at (x, y): `base` at its elliptic rim, turned by `angle` radians, and `height` nearer in its middle; all mm."""
    cos, sin = np.cos(angle), np.sin(angle)
    dx, dy = x - centre[0], y - centre[1]
    r2 = ((dx * cos + dy * sin) / radii[0]) ** 2 + ((dy * cos - dx * sin) / radii[1]) ** 2
    return base - height * (1 - r2)


def distance_to_path(x: np.ndarray, y: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to a polyline [k, 2] and the place of the nearest point along it in [0, 1]; both shaped like `x`."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    before = np.concatenate([[0], np.cumsum(lengths)])
    best, along = np.full(x.shape, np.inf), np.zeros(x.shape)
    for start, end, length, travelled in zip(path[:-1], path[1:], lengths, before, strict=False):
        direction = (end - start) / length
        s = np.clip((x - start[0]) * direction[0] + (y - start[1]) * direction[1], 0, length)
        distance = np.hypot(x - start[0] - s * direction[0], y - start[1] - s * direction[1])
        nearer = distance < best
        best, along = np.where(nearer, distance, best), np.where(nearer, (travelled + s) / before[-1], along)
    return best, along
