"""What a clip's pictures and flow say about how much a scene of it must hold. Seconds, before any training; no randomness."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np

from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames

Item = TypeVar("Item")
SCALES = (0.8, 1.2, 1.8, 2.7, 4.0, 6.0, 9.0, 13.5)  # pixels: standard deviations that a Gaussian of the picture may have
SPACING = 1.67  # Gaussians of standard deviation σ lie this many σ apart, as the first ones do (`engine.training.initialise`)
LOST_DETAIL = 3.0  # grey levels that a blur may cost before it is seen; noise may be lost freely
PICTURES = 6  # frames that are looked at closely
MOMENTS = 48  # frames that are looked at coarsely
COARSE = (24, 18)  # size at which change in time is followed
CELLS = (8, 12, 16, 24, 32, 48, 64, 96, 128)
KNOTS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
LOST_MOTION = 0.3  # pixels of the flow: what flow is wrong by on good texture
LOST_CHANGE = 5.0  # grey levels


@dataclass(frozen=True)
class Statistics:
    """Figures of a clip.

    Attributes
    ----------
    noise : float
        Standard deviation of the pictures' noise, grey levels.
    gaussians : float
        How many Gaussians hold one frame's valid pixels, see `gaussians_needed`.
    unmatched : float
        Share of the valid pixels that optical flow cannot bring back to the first frame: what must be held beside it.
    cells : int
        Grid cells across the picture that hold the motion and the change of colour, see `cells_needed`.
    knots : int
        Moments between which motion and colour change evenly, see `knots_needed`.
    delta_color : float
        Grey levels by which the colour of tissue changes along its way, 99th percentile.
    motion : float
        Pixels (of the flow) that tissue moves, 99th percentile.
    believed : float
        Share of the pixels whose flow is believed, over all pairs.
    """

    noise: float
    gaussians: float
    unmatched: float
    cells: int
    knots: int
    delta_color: float
    motion: float
    believed: float


def measure(frames: TrainingFrames, supervision: FlowSupervision | None) -> Statistics:
    """The statistics of a clip at its working size. Without flow (one frame, or no flow wanted) motion is unknown: the finest."""
    train = frames.clip.train_frames
    near, many = spread(train, PICTURES), spread(train, MOMENTS)
    small = {i: frames.image(i) for i in {*near, *many}}
    valid = {i: frames.valid(i) for i in small}
    noise = float(np.median([noise_of(small[i]) for i in near]))
    with ThreadPoolExecutor() as pool:
        needed = pool.map(lambda i: gaussians_needed(small[i], valid[i], noise), near)
        moments = list(pool.map(lambda i: _cells(small[i].astype(np.float32), valid[i]), many))
        ways = []
        if supervision is not None:
            ways = list(pool.map(lambda i: way_from_first(supervision, i, small[train[0]], small[i], noise), many[1:]))
        gaussians = max(needed)
        if not any(weight.any() for _, weight in ways):
            knots = knots_needed(moments, LOST_CHANGE)
            return Statistics(noise, gaussians, 1.0 if len(train) > 1 else 0.0, CELLS[-1], knots, 255.0, 0.0, 0.0)
        assert supervision is not None
        width, height = supervision.size
        still = np.zeros((height, width, 2), np.float32), np.ones((height, width), bool)
        coarse_ways = list(pool.map(lambda way: _cells(*way), (still, *ways)))
        changes = [recolouring(frames, supervision, i) for i in near[1:]]
        cells = [*pool.map(lambda way: cells_needed(way[0], way[1], LOST_MOTION), spread(ways, PICTURES))]
        cells += pool.map(lambda change: cells_needed(change[0], change[1], LOST_CHANGE), changes)
    lengths = np.concatenate([np.linalg.norm(flow[weight], axis=-1) for flow, weight in ways])
    weights = [float(pair.weight.float().mean()) for pairs in supervision.pairs.values() for pair in pairs]
    return Statistics(
        noise=noise,
        gaussians=gaussians,
        unmatched=float(np.mean([unmatched(frames, supervision, i) for i in near[1:]])),
        cells=max(cells),
        knots=max(knots_needed(moments, LOST_CHANGE), knots_needed(coarse_ways, LOST_MOTION)),
        delta_color=float(np.percentile(np.concatenate([np.abs(change[both]).max(1) for change, both in changes]), 99)),
        motion=float(np.percentile(lengths, 99)),
        believed=float(np.mean(weights)),
    )


def spread(items: Sequence[Item], count: int) -> list[Item]:
    """At most `count` of the items, evenly spread, the first and the last among them."""
    return [items[i] for i in np.unique(np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int))]


def noise_of(rgb: np.ndarray) -> float:
    """Standard deviation of the noise of a picture, grey levels: by the median response to a mask in which straight structure cancels out
    (Immerkær 1996)."""
    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    response = cv2.filter2D(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), -1, mask)
    return float(np.median(np.abs(response)) / (0.6745 * 6))


def gaussians_needed(rgb: np.ndarray, valid: np.ndarray, noise: float) -> float:
    """Σ 1 / (s σ(p))² over the valid pixels p: how many Gaussians a picture takes.

    σ(p) is the widest blur that costs the surroundings of p no more than the noise and `LOST_DETAIL` grey levels; s is `SPACING`.
    Plain surfaces take few and large Gaussians, fine texture and edges many small ones.

    Parameters
    ----------
    rgb : uint8 [H, W, 3]
    valid : bool [H, W]
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    width = np.full(grey.shape, SCALES[0], np.float32)
    fine = np.ones(grey.shape, bool)
    for sigma in SCALES[1:]:
        lost = (grey - cv2.GaussianBlur(grey, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)) ** 2
        fine &= cv2.GaussianBlur(lost, (0, 0), sigma, borderType=cv2.BORDER_REFLECT) <= noise**2 + LOST_DETAIL**2
        width[fine] = sigma
    return float((1 / (SPACING * width[valid]) ** 2).sum())


def way_from_first(
    supervision: FlowSupervision, index: int, before: np.ndarray, after: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Flow of the first training frame to another, float32 [h, w, 2] in pixels of the flow, and where it is believed, bool [h, w].

    0 where the two frames, `before` and `after`, look the same but for noise: there flow follows the noise, on plain surfaces by pixels.
    """
    first = supervision.frames.clip.train_frames[0]
    flow = supervision.flow(first, index)
    start, end = (smooth(cv2.resize(picture, supervision.size, interpolation=cv2.INTER_AREA)) for picture in (before, after))
    flow[np.abs(start - end).max(2) < 1 + noise] = 0
    return flow, _believed(supervision, first, index)


def smooth(rgb: np.ndarray) -> np.ndarray:
    """The picture blurred by 2 pixels, float32: its noise is a seventh of what it was."""
    return cv2.GaussianBlur(rgb.astype(np.float32), (0, 0), 2.0)


def unmatched(frames: TrainingFrames, supervision: FlowSupervision, index: int) -> float:
    """Share of the valid pixels of a training frame without a believed way to the first."""
    first = frames.clip.train_frames[0]
    valid = cv2.resize(frames.valid(index).astype(np.uint8), supervision.size, interpolation=cv2.INTER_NEAREST) > 0
    return float(1 - _believed(supervision, index, first)[valid].mean()) if valid.any() else 1.0


def _believed(supervision: FlowSupervision, here: int, there: int) -> np.ndarray:
    """Where the flow between two frames of a pair is believed, bool [h, w]."""
    pair = supervision.pair(here, there)
    assert pair is not None
    return pair.weight[0].float().cpu().numpy() > 0.5


def recolouring(frames: TrainingFrames, supervision: FlowSupervision, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Grey levels by which the colours of a frame differ from those of the first, float32 [H, W, 3], blurred by 2 pixels; and where both
    frames are valid, bool [H, W].

    The first frame is warped along the flow or left where it is, whichever is more alike: what chars is not matched by flow, and what
    comes and goes is a change too.
    """
    first = frames.clip.train_frames[0]
    here, start = smooth(frames.image(index)), frames.image(first)
    moved, unmoved = here - smooth(supervision.warped(start, first, index)[0]), here - smooth(start)
    both = frames.valid(first) & frames.valid(index)
    return np.where(np.abs(moved).max(2, keepdims=True) < np.abs(unmoved).max(2, keepdims=True), moved, unmoved), both


def _cells(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Mean of `values` [H, W, C] over the pixels of `weight` in each cell of `COARSE`, float32 [cells, C]; NaN where they are few."""
    share = cv2.resize(weight.astype(np.float32), COARSE, interpolation=cv2.INTER_AREA)[..., None]
    total = cv2.resize(values * weight[..., None], COARSE, interpolation=cv2.INTER_AREA)
    return np.where(share > 0.5, total / np.maximum(share, 1e-6), np.nan).reshape(-1, values.shape[2])


def cells_needed(values: np.ndarray, weight: np.ndarray, tolerance: float) -> int:
    """The fewest cells across the picture whose means, interpolated, follow `values` [H, W, C] within `tolerance`: root mean square over
    the pixels of `weight` (bool [H, W]), in all but a twentieth of the picture's blocks."""
    height, width = weight.shape
    known = weight.astype(np.float32)
    for cells in CELLS:
        if cells >= min(width, height):
            return cells
        share = cv2.resize(known, (cells, cells), interpolation=cv2.INTER_AREA)
        mean = cv2.resize(values * known[..., None], (cells, cells), interpolation=cv2.INTER_AREA) / np.maximum(share, 1e-6)[..., None]
        mean[share < 1e-6] = 0
        error = ((cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR) - values) ** 2).sum(2) * known
        block = cv2.resize(error, COARSE, interpolation=cv2.INTER_AREA) / np.maximum(
            cv2.resize(known, COARSE, interpolation=cv2.INTER_AREA), 0.1
        )
        if np.percentile(block, 95) <= tolerance**2:
            return cells
    return CELLS[-1]


def knots_needed(moments: Sequence[np.ndarray], tolerance: float) -> int:
    """The fewest evenly spread moments, straight lines in between, that follow all but a fiftieth of the cells within `tolerance`.

    Parameters
    ----------
    moments : sequence of float [cells, channels], one a frame, evenly spread in time; NaN where unknown
    """
    values = np.stack(moments)  # [T, cells, channels]
    count = len(values)
    often = np.isfinite(values).all(2).mean(0) > 0.8
    signals = values[:, often].reshape(count, -1)
    if not signals.size:
        return KNOTS[-1]
    times = np.linspace(0, 1, count)
    for column in signals.T:  # the few unknown moments in between
        known = np.isfinite(column)
        column[~known] = np.interp(times[~known], times[known], column[known])
    for knots in KNOTS:
        if knots >= count:
            break
        hats = np.stack([np.interp(times, np.linspace(0, 1, knots), row) for row in np.eye(knots)], 1)
        error = signals - hats @ np.linalg.lstsq(hats, signals, rcond=None)[0]
        spoilt = np.sqrt((error.reshape(count, -1, values.shape[2]) ** 2).sum(2).mean(0))
        if np.percentile(spoilt, 98) <= tolerance:
            return knots
    return count
