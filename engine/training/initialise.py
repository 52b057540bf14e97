"""The first Gaussians: training frames only, unprojected; tissue hidden in one frame comes from others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import reduce
from typing import NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.errors import ClipError
from degense.engine.field.model import is_persistent
from degense.engine.latest import Latest
from degense.engine.training.flow.supervision import FlowSupervision, from_nearest
from degense.engine.training.frames import TrainingFrames

DIFFERENT = 30  # grey levels by which a pixel must differ from the first frame to be taken for something else
EVERY, LIVES = 4, (12, 24)  # half of the longest life, in training frames; half lives that fill a clip, the fewest and the most
LOOKED_AT = 240  # training frames that are looked at for what they add, at most
EDGES = 1.5, 1.12  # age in 1/ω at which a life ends: of a Gaussian window, where .32 of it is left, and of a flat one, where .29 is
SHOWN = 1.18, 1.0  # age up to which a point of such windows is taken to show its place: half of it is left, or .6
GAP = 0.35  # of the time between a frame that shows a point and one that does not, its life has so much
AROUND, ALIKE = 17, 0.25  # a frame shows a point where it has the colours of this share of the points in a square of so many pixels


class Points(NamedTuple):
    """Where Gaussians begin."""

    means: np.ndarray  # float [n, 3]
    colors: np.ndarray  # float [n, 3]
    pitches: np.ndarray  # float [n]; distance to the next point, in units of the scene
    temporal_windows: np.ndarray  # float [n, 2]; as in `SceneModel`: the inverse scale is 0 for persistent points, negative for flat ones
    velocities: np.ndarray  # float [n, 3]


def initial_gaussians(
    frames: TrainingFrames, flow: FlowSupervision | None, budget: int, rank: int, generator: np.random.Generator, color_knots: int = 0
) -> tuple[dict[str, Tensor], Tensor]:
    """Canonical parameters and the bounds of the field.

    The first training frame is sampled on a jittered grid. The later ones add what those before could not show: pixels that were invalid so
    far (behind a tool) give persistent points; pixels that look different by more than `DIFFERENT` grey levels (a tool that came, a char)
    and are shown by no earlier point give transient points, which live as long as the recording shows them where their velocity takes
    them, so that nothing that comes later hides what was there before. Tissue that only moved is recognised by its flow from the first
    frame and gives none: the field moves what is there.

    There are at most `budget` points; where that is too few, the first frame keeps its own and all others give up the same share. The
    bounds float [2, 3] are robust percentiles of the cloud (0.5 – 99.5) with a margin of a tenth of their extent. ClipError when hardly a
    pixel is valid.
    """
    width, height = frames.size
    stride = max(1.0, float(np.sqrt(width * height / (0.6 * budget))))
    points = _within(list(_points(frames, flow, stride, generator)), budget, generator)
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


def _points(frames: TrainingFrames, flow: FlowSupervision | None, stride: float, generator: np.random.Generator) -> Iterator[Points]:
    """The points of each training frame that adds any, the first frame's first."""
    train, clip, (width, height) = frames.clip.train_frames, frames.clip, frames.size
    looked_at = [train[i] for i in np.unique(np.linspace(0, len(train) - 1, min(len(train), LOOKED_AT)).round().astype(int))]
    kept = Latest(4 * LOOKED_AT // LIVES[1] + 1)  # a life is looked at over two halves before and after

    def picture(frame: int) -> np.ndarray:
        return kept.get(frame, lambda: cv2.GaussianBlur(frames.image(frame), (0, 0), max(0.6, stride / 3)))

    shown = np.zeros((height, width, 3), np.uint8)
    known = np.zeros((height, width), bool)
    speck = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (int(stride) | 1, int(stride) | 1))
    transient_points: list[Points] = []
    for frame in looked_at:
        valid, smooth = frames.valid(frame), picture(frame)
        expected = [shown] if flow is None else [shown, flow.warped(shown, train[0], frame)[0]]
        different = valid & known & (np.minimum.reduce([unlike(smooth, image) for image in expected]) > DIFFERENT)
        until = len(clip) - 1 if frame == train[-1] else frame  # nothing comes after the last one
        different &= ~_covered(transient_points, frames, frame, until, smooth, stride)
        fresh = (valid & ~known) | (cv2.morphologyEx(different.astype(np.uint8), cv2.MORPH_OPEN, speck) > 0)
        if fresh.any():
            pixels = jittered_grid(width, height, stride, generator)
            pixels = pixels[fresh[pixels[:, 1].astype(int), pixels[:, 0].astype(int)]]
            rows, columns = pixels[:, 1].astype(int), pixels[:, 0].astype(int)
            z, camera, transient = filled(frames.depth(frame))[rows, columns], frames.cameras[frame], known[rows, columns]
            means, colors = camera.unproject(pixels, z), smooth[rows, columns]
            windows, velocities = np.stack([np.full(len(pixels), clip.time(frame)), np.zeros(len(pixels))], 1), np.zeros_like(means)
            if transient.any() and len(train) > 1:
                speeds = np.zeros_like(means[transient]) if flow is None else flow.velocity(frame, pixels[transient])
                middle, half, cut = _lives(frames, looked_at, picture, frame, pixels[transient], means[transient], speeds)
                rate = np.where(cut, EDGES[1], EDGES[0]) / half
                windows[transient] = np.stack([middle, np.where(cut, -rate, rate)], 1)
                means[transient] += speeds * (middle - clip.time(frame))[:, None]
                velocities[transient] = speeds / rate[:, None]
            points = Points(means, colors / 255.0, stride * z / camera.fx, windows, velocities)
            transient_points.append(Points(*(values[transient] for values in points)))
            yield points
        shown[valid & ~known] = smooth[valid & ~known]
        known |= valid


def _covered(earlier: list[Points], frames: TrainingFrames, frame: int, until: int, picture: np.ndarray, stride: float) -> np.ndarray:
    """Which pixels of a frame are shown in its colours by earlier transient points that live until another, bool [H, W]."""
    covered = np.zeros(picture.shape[:2], np.uint8)
    for points in earlier:
        middle, rate = points.temporal_windows.T
        age, last = (np.abs(rate) * (frames.clip.time(i) - middle) for i in (frame, until))
        limit = np.where(rate < 0, SHOWN[1], SHOWN[0])
        alive = (np.abs(age) < limit) & (last < limit)
        means = points.means[alive] + points.velocities[alive] * age[alive, None]
        place, inside = _seen(frames, frame, means)
        there = place[inside & _alike(picture, place, points.colors[alive] * 255)]
        covered[there[:, 1], there[:, 0]] = 1
    side = 2 * int(np.ceil(stride)) + 1
    return cv2.dilate(covered, np.ones((side, side), np.uint8)) > 0


def _lives(
    frames: TrainingFrames,
    looked_at: list[int],
    picture: Callable[[int], np.ndarray],
    frame: int,
    pixels: np.ndarray,
    means: np.ndarray,
    speeds: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lives of points that a frame shows at `pixels` [n, 2]: middle and half, float [n] each, and whether evidence ends them, bool [n].

    A point lives while the frames before and after show it where its velocity takes it: where they have the colours of `ALIKE` of the
    points around that are in view there. `GAP` says how far a life goes into the time until the first frame that does not; it ends where a
    point leaves the view. Where no evidence ends it, it is as long as the longest, around the frame.
    """
    clip, now = frames.clip, frames.clip.time(frame)
    number, count = looked_at.index(frame), len(clip.train_frames)
    longest = 2 / (min(count, max(LIVES[0], min(count // EVERY, LIVES[1]))) - 1)
    columns, rows = pixels.astype(int).T
    colors = picture(frame)[rows, columns]
    ends = []
    for sign, others in ((1, looked_at[number + 1 :]), (-1, looked_at[:number][::-1])):
        end, last, living = np.full(len(pixels), now + 2 * sign * longest), now, np.ones(len(pixels), bool)
        for other in others:
            t = clip.time(other)
            if abs(t - now) > 2 * longest or not living.any():
                break
            place, inside = _seen(frames, other, means + speeds * (t - now))
            in_view = _share_around(inside, rows, columns, frames.size)
            alike = _share_around(inside & _alike(picture(other), place, colors), rows, columns, frames.size)
            left, unseen = living & (in_view < 0.5), living & (in_view >= 0.5) & (alike < ALIKE * in_view)
            end[left], end[unseen] = t, last + GAP * (t - last)
            living, last = living & ~left & ~unseen, t
        ends.append(end)
    stop, start = ends
    cut = np.minimum(stop - now, now - start) < EDGES[0] * longest
    half = np.where(cut, np.minimum((stop - start) / 2, longest), longest)
    middle = np.clip((start + stop) / 2, np.maximum(start + half, now - half), np.minimum(stop - half, now + half))
    return np.where(cut, middle, now), half, cut


def _seen(frames: TrainingFrames, frame: int, means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (column, row), int [n, 2], at which a frame's camera has points, clipped to the picture; and which are in view, bool [n]."""
    place, z = frames.cameras[frame].project(means)
    inside = (z > 0) & (place >= 0).all(1) & (place < frames.size).all(1)
    return np.where(inside[:, None], place, 0).astype(int), inside


def _alike(picture: np.ndarray, place: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Whether a picture has colours [n, 3], within `DIFFERENT` grey levels, at or beside pixels (column, row), int [n, 2]; bool [n]."""
    wide, (columns, rows) = cv2.copyMakeBorder(picture, 1, 1, 1, 1, cv2.BORDER_REPLICATE).astype(np.int16), place.T
    near = (np.abs(wide[rows + y, columns + x] - colors).max(1) for y in range(3) for x in range(3))
    return reduce(np.minimum, near) <= DIFFERENT


def _share_around(values: np.ndarray, rows: np.ndarray, columns: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Which share of the points around each, in a square of `AROUND` pixels, has a value, float [n] of bool [n] at pixels."""
    pictures = np.zeros((2, *size[::-1]), np.float32)
    pictures[0, rows, columns], pictures[1, rows, columns] = values, 1
    total, count = (cv2.boxFilter(picture, -1, (AROUND, AROUND), normalize=False, borderType=cv2.BORDER_CONSTANT) for picture in pictures)
    return total[rows, columns] / count[rows, columns]


def persistent_only(canonical: dict[str, Tensor]) -> dict[str, Tensor]:
    """The persistent Gaussians of `initial_gaussians`; those of the first frame always are."""
    persistent = is_persistent(canonical["temporal_windows"])
    return {name: values[persistent] for name, values in canonical.items()}


def _within(found: list[Points], budget: int, generator: np.random.Generator) -> Points:
    """The points of all frames, at most `budget`: the first one keeps its own, the others give up the same share."""
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
