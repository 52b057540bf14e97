"""The first Gaussians: training frames only, unprojected; tissue hidden in one frame comes from others."""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from typing import NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.errors import ClipError
from degense.engine.field.model import is_persistent
from degense.engine.training.flow.supervision import FlowSupervision, from_nearest
from degense.engine.training.frames import TrainingFrames

KEY_EVERY, KEYS = 4, (12, 24)  # training frames from one key frame to the next; the fewest and the most of them
DIFFERENT = 30  # grey levels by which a pixel must differ from the first frame to be taken for something else


class Points(NamedTuple):
    """Where Gaussians begin."""

    means: np.ndarray  # float [n, 3]
    colors: np.ndarray  # float [n, 3]
    pitches: np.ndarray  # float [n]; distance to the next point, in units of the scene
    temporal_windows: np.ndarray  # float [n, 2]; centre and inverse scale; the latter is 0 for persistent points
    velocities: np.ndarray  # float [n, 3]


def initial_gaussians(
    frames: TrainingFrames, flow: FlowSupervision | None, budget: int, rank: int, generator: np.random.Generator, color_knots: int = 0
) -> tuple[dict[str, Tensor], Tensor]:
    """Canonical parameters and the bounds of the field.

    The first training frame is sampled on a jittered grid. Key frames then add what it could not show: pixels that were invalid so far
    (behind a tool) give persistent points; pixels that look different by more than `DIFFERENT` grey levels (a tool that came, a char) give
    transient points around their key frame, so that nothing that comes later hides what was there before. Tissue that only moved is
    recognised by its flow from the first frame and gives none: the field moves what is there.

    There are at most `budget` points; where that is too few, the first frame keeps its own and all key frames give up the same share. The
    bounds float [2, 3] are robust percentiles of the cloud (0.5 – 99.5) with a margin of a tenth of their extent. ClipError when hardly a
    pixel is valid.
    """
    width, height = frames.size
    stride = max(1.0, float(np.sqrt(width * height / (0.6 * budget))))
    points = _within(list(_key_points(frames, flow, stride, generator)), budget, generator)
    means = torch.from_numpy(points.means).float()
    count = len(means)
    if count == 0:
        raise ClipError(f"{frames.clip.path}: hardly a pixel is valid, so there is nothing to start from; check the mask polarity")
    log_scales = torch.from_numpy(np.log(0.6 * points.pitches.astype(np.float64))).float()  # torch.log, on threads, once differed
    low, high = torch.from_numpy(np.percentile(means.numpy(), [0.5, 99.5], axis=0)).float()
    margin = 0.1 * (high - low).clamp_min(0.05)
    canonical = {
        "means": means,
        "log_scales": log_scales[:, None].repeat(1, 3),
        "quats": torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        "logits": torch.full((count,), 2.0),
        "colors": torch.from_numpy(points.colors).float(),
        "color_residuals": torch.zeros(count, color_knots, 3),
        "temporal_windows": torch.from_numpy(points.temporal_windows).float(),
        "velocities": torch.from_numpy(points.velocities).float(),
        "semantics": torch.from_numpy(generator.normal(0, 0.01, (count, rank))).float(),
    }
    return canonical, torch.stack([low - margin, high + margin])


def _key_points(frames: TrainingFrames, flow: FlowSupervision | None, stride: float, generator: np.random.Generator) -> Iterator[Points]:
    """The points of each key frame, the first training frame's first: what those before it did not show."""
    train, (width, height) = frames.clip.train_frames, frames.size
    keys = [train[i] for i in np.linspace(0, len(train) - 1, key_count(len(train))).round().astype(int)]
    rate = 0.75 * (len(keys) - 1)  # two neighbouring key frames, 2 / (keys − 1) apart, share the time between them
    shown = np.zeros((height, width, 3), np.uint8)
    known = np.zeros((height, width), bool)
    for key in keys:
        valid, depth = frames.valid(key), filled(frames.depth(key))
        smooth = cv2.GaussianBlur(frames.image(key), (0, 0), max(0.6, stride / 3))
        expected = [shown] if flow is None else [shown, flow.warped(shown, train[0], key)[0]]
        fresh = valid & (~known | (np.minimum.reduce([unlike(smooth, image) for image in expected]) > DIFFERENT))
        pixels = jittered_grid(width, height, stride, generator)
        pixels = pixels[fresh[pixels[:, 1].astype(int), pixels[:, 0].astype(int)]]
        rows, columns = pixels[:, 1].astype(int), pixels[:, 0].astype(int)
        z, camera = depth[rows, columns], frames.cameras[key]
        means, transient = camera.unproject(pixels, z), known[rows, columns]
        windows = np.stack([np.full(len(pixels), frames.clip.time(key)), np.where(transient, rate, 0.0)], 1)
        velocities = np.zeros_like(means)
        if flow is not None and rate > 0 and transient.any():
            velocities[transient] = flow.velocity(key, pixels[transient]) / rate
        yield Points(means, smooth[rows, columns] / 255.0, stride * z / camera.fx, windows, velocities)
        shown[valid & ~known] = smooth[valid & ~known]
        known |= valid


def key_count(frames: int) -> int:
    """How many of so many training frames are key frames."""
    return min(frames, max(KEYS[0], min(frames // KEY_EVERY, KEYS[1])))


def persistent_only(canonical: dict[str, Tensor]) -> dict[str, Tensor]:
    """The persistent Gaussians of `initial_gaussians`; those of the first frame always are."""
    persistent = is_persistent(canonical["temporal_windows"])
    return {name: values[persistent] for name, values in canonical.items()}


def _within(found: list[Points], budget: int, generator: np.random.Generator) -> Points:
    """The points of all key frames, at most `budget`: the first one keeps its own, the others give up the same share."""
    first, rest = len(found[0].means), sum(len(points.means) for points in found[1:])
    share = min(1.0, max(0, budget - first) / max(rest, 1))
    chosen = []
    for number, points in enumerate(found):
        count = len(points.means)
        wanted = min(count, budget) if number == 0 else int(share * count)
        rows = slice(None) if wanted == count else np.sort(generator.choice(count, wanted, replace=False))
        chosen.append([values[rows] for values in points])
    return Points(*(np.concatenate(column) for column in zip(*chosen, strict=True)))


def jittered_grid(width: int, height: int, stride: float, generator: np.random.Generator) -> np.ndarray:
    """Pixel positions [n, 2] (x, y), one in each cell of `stride` × `stride` pixels."""
    x, y = np.meshgrid(np.arange(0, width, stride), np.arange(0, height, stride))
    positions = np.stack([x, y], -1).reshape(-1, 2) + generator.uniform(0.25, 0.75, (x.size, 2)) * stride
    return positions[(positions[:, 0] < width) & (positions[:, 1] < height)]


def unlike(picture: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """How far, uint8 [H, W] grey levels, a picture is from the likest colour within a pixel of an expected one, both uint8 [H, W, 3]."""
    height, width = picture.shape[:2]
    wide = cv2.copyMakeBorder(expected, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    shifted = (wide[y : y + height, x : x + width] for y in range(3) for x in range(3))
    return reduce(cv2.min, (reduce(cv2.max, cv2.split(cv2.absdiff(picture, near))) for near in shifted))


def filled(depth: np.ndarray) -> np.ndarray:
    """Depth with unknown pixels (0) filled from their nearest known neighbour; 1 when nothing is known."""
    return from_nearest(depth, depth > 0) if (depth > 0).any() else np.ones_like(depth)
