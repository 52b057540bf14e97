"""The first Gaussians: training frames only, unprojected; tissue hidden in one frame comes from others."""

from __future__ import annotations

from functools import reduce

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


def initial_gaussians(
    frames: TrainingFrames, flow: FlowSupervision | None, budget: int, rank: int, generator: np.random.Generator, color_knots: int = 0
) -> tuple[dict[str, Tensor], Tensor]:
    """Canonical parameters and the bounds of the field.

    The first training frame is sampled on a jittered grid. Key frames then add what it could not show: pixels that were invalid so far
    (behind a tool) give persistent points; pixels that look different by more than `DIFFERENT` grey levels (a tool that came, a char) give
    points that live around their key frame, so that nothing that comes later stands in the way of what was there before. Tissue that only
    moved is recognised by its flow from the first frame and gives none: it is for the field to move what is there.

    Parameters
    ----------
    budget : int
        At most this many points. Where that is too few, the first frame keeps its own and all key frames give up the same share.

    Returns
    -------
    canonical : dict of Tensor
        See `engine.field.SceneModel`.
    bounds : float [2, 3]
        Robust percentiles of the cloud (0.5 – 99.5) with a margin of a tenth of their extent.
    """
    train = frames.clip.train_frames
    keys = [train[i] for i in np.linspace(0, len(train) - 1, key_count(len(train))).round().astype(int)]
    width, height = frames.size
    stride = max(1.0, float(np.sqrt(width * height / (0.6 * budget))))
    shown = np.zeros((height, width, 3), np.uint8)
    known = np.zeros((height, width), bool)
    rate = 0.75 * (len(keys) - 1)  # two neighbouring key frames, 2 / (keys − 1) apart, share the time between them
    found: list[tuple[np.ndarray, ...]] = []
    for key in keys:
        image, valid, depth = frames.image(key), frames.valid(key), filled(frames.depth(key))
        smooth = cv2.GaussianBlur(image, (0, 0), max(0.6, stride / 3))
        expected = [shown] if flow is None else [shown, flow.warped(shown, train[0], key)[0]]
        fresh = valid & (~known | (np.minimum.reduce([unlike(smooth, picture) for picture in expected]) > DIFFERENT))
        pixels = jittered_grid(width, height, stride, generator)
        pixels = pixels[fresh[pixels[:, 1].astype(int), pixels[:, 0].astype(int)]]
        rows, columns = pixels[:, 1].astype(int), pixels[:, 0].astype(int)
        z = depth[rows, columns]
        born = np.stack([np.full(len(pixels), frames.clip.time(key)), np.where(known[rows, columns], rate, 0.0)], 1)
        place, pitch = frames.cameras[key].unproject(pixels, z), stride * z / frames.cameras[key].fx
        brief = born[:, 1] > 0
        drift = np.zeros_like(place)
        if flow is not None and brief.any():
            drift[brief] = flow.velocity(key, pixels[brief]) / rate
        found.append((place, smooth[rows, columns] / 255.0, pitch, born, drift))
        shown[valid & ~known] = smooth[valid & ~known]
        known |= valid
    points, colors, pitches, temporal_windows, velocities = _within(found, budget, generator)
    means = torch.from_numpy(points).float()
    count = len(means)
    if count == 0:
        raise ClipError(f"{frames.clip.path}: hardly a pixel is valid, so there is nothing to start from; check the mask polarity")
    log_scales = torch.from_numpy(np.log(0.6 * pitches.astype(np.float64))).float()  # torch.log, on threads, once gave another last bit
    low, high = torch.from_numpy(np.percentile(means.numpy(), [0.5, 99.5], axis=0)).float()
    margin = 0.1 * (high - low).clamp_min(0.05)
    canonical = {
        "means": means,
        "log_scales": log_scales[:, None].repeat(1, 3),
        "quats": torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        "logits": torch.full((count,), 2.0),
        "colors": torch.from_numpy(colors).float(),
        "color_residuals": torch.zeros(count, color_knots, 3),
        "temporal_windows": torch.from_numpy(temporal_windows).float(),
        "velocities": torch.from_numpy(velocities).float(),
        "semantics": torch.from_numpy(generator.normal(0, 0.01, (count, rank))).float(),
    }
    return canonical, torch.stack([low - margin, high + margin])


def key_count(frames: int) -> int:
    """How many of so many training frames are key frames."""
    return min(frames, max(KEYS[0], min(frames // KEY_EVERY, KEYS[1])))


def persistent_only(canonical: dict[str, Tensor]) -> dict[str, Tensor]:
    """The Gaussians of `initial_gaussians` that exist for ever; those of the first frame always do."""
    persistent = is_persistent(canonical["temporal_windows"])
    return {name: values[persistent] for name, values in canonical.items()}


def _within(found: list[tuple[np.ndarray, ...]], budget: int, generator: np.random.Generator) -> tuple[np.ndarray, ...]:
    """The points of all key frames, at most `budget`: the first one keeps its own, the others give up the same share."""
    first, rest = len(found[0][0]), sum(len(part[0]) for part in found[1:])
    share = min(1.0, max(0, budget - first) / max(rest, 1))
    kept = []
    for number, part in enumerate(found):
        count = len(part[0])
        wanted = min(count, budget) if number == 0 else int(share * count)
        rows = slice(None) if wanted == count else np.sort(generator.choice(count, wanted, replace=False))
        kept.append([values[rows] for values in part])
    return tuple(np.concatenate(column) for column in zip(*kept, strict=True))


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
