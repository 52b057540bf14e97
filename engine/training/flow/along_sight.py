"""Motion of tissue along the line of sight, told by the noisy depth of all frames together.

Depth of a stereo endoscope errs in each frame by more than tissue comes and goes. But tissue moves in few ways: it breathes, it is pulled.
Written as a matrix of frames by places, its motion is of low rank, like the tracks of a rigid thing (Tomasi and Kanade, 1992), while the
errors of single frames fill all ranks alike.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.motion import sample
from degense.engine.training.flow.supervision import STEADY, FlowSupervision, from_nearest

TRUSTED = 0.9  # precision of depth above which that of two frames tells their motion by itself
CELL = 0.025  # of the width: side of a cell, over which motion is averaged
KNOWN = 0.25  # of a cell's pixels must have a motion, for it to have one
OFTEN = 0.5  # of the frames in which a cell must have one
COURSES = 6  # over time that tissue moves by, at most
ROUNDS = 30  # in which they are found, and what is not known is filled in by them
BLOCK = 8  # cells: side of what is held out of a frame to find how many courses there are; errors of depth are alike within less
SMOOTH = 2.0  # cells: σ of the mean around a cell, since tissue moves smoothly


def motion_along_sight(flow: FlowSupervision) -> dict[int, Tensor]:
    """How far what is seen in each training frame has gone since the first one along that one's line of sight, by frame.

    float16 [h, w] at the size of the flow, on its device, scene units, away from the camera. What is seldom seen goes as the nearest tissue
    does. Empty where no depth was measured, where that of single frames can be trusted, and where nothing is known.
    """
    first, *others = flow.frames.clip.train_frames
    if not 0 < flow.depth_precision < TRUSTED:
        return {}
    width, height = flow.size
    cells = max(1, round(1 / CELL)), max(1, round(height / (CELL * width)))
    start = _depth(flow, first)
    motion = low_rank(np.stack([_by_cell(_measured(flow, first, start, frame), cells) for frame in others]))
    known = np.isfinite(motion).all(0)
    if not known.any():
        return {}
    whole = np.moveaxis(from_nearest(np.moveaxis(motion, 0, 2), known), 2, 0).astype(np.float32)
    gone = {first: np.zeros((height, width), np.float32)}
    for frame, values in zip(others, whole, strict=True):
        fine = cv2.resize(cv2.GaussianBlur(values, (0, 0), SMOOTH), flow.size, interpolation=cv2.INTER_LINEAR)
        way = from_nearest(flow.flow(frame, first), flow.seen(frame, first))
        x, y = np.arange(width) + way[..., 0], np.arange(height)[:, None] + way[..., 1]
        gone[frame] = cv2.remap(fine, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return {frame: torch.from_numpy(values).to(flow.frames.device).half() for frame, values in gone.items()}


def _measured(flow: FlowSupervision, first: int, start: np.ndarray, frame: int) -> np.ndarray:
    """Motion from the first frame, of depth `start`, to another by what both measured, float32 [h, w], by its pixels; NaN: unknown."""
    frames, (width, height) = flow.frames, flow.size
    end = _depth(flow, frame)
    way = flow.flow(first, frame)
    known = (start > 0) & flow.seen(first, frame) & (sample((end > 0).astype(np.float32), way) > 0.999)
    there = sample(end, way)
    known &= np.abs(there - start) < STEADY * start
    pixels = np.argwhere(known)[:, ::-1] + 0.5
    scale = np.array(frames.size) / np.array(flow.size)
    here, other = frames.cameras[first], frames.cameras[frame]
    moved = other.unproject((pixels + way[known]) * scale, there[known]) - here.unproject(pixels * scale, start[known])
    motion = np.full((height, width), np.nan, np.float32)
    motion[known] = moved @ here.viewmat[2, :3]
    return motion


def _depth(flow: FlowSupervision, frame: int) -> np.ndarray:
    """A frame's depth at the size of the flow, float32 [h, w]; 0 where unknown."""
    return cv2.resize(flow.frames.depth(frame), flow.size, interpolation=cv2.INTER_NEAREST)


def _by_cell(values: np.ndarray, cells: tuple[int, int]) -> np.ndarray:
    """Means over cells, float32 [rows, columns] of as many `cells` (columns, rows), of values [h, w]; NaN where too few are known."""
    known = np.isfinite(values)
    total, share = (
        cv2.resize(picture, cells, interpolation=cv2.INTER_AREA) for picture in (np.where(known, values, 0), known.astype(np.float32))
    )
    return np.where(share >= KNOWN, total / np.maximum(share, 1e-6), np.nan)


def low_rank(motion: np.ndarray) -> np.ndarray:
    """What stands out of the noise in motion [T, rows, columns] of cells since a first frame, in T later ones; NaN: not known.

    The error of the first frame is a cell's own and the same in all later ones; beside it a cell has a sum of few courses over time that
    all cells share: as many as predict best the blocks of cells that are held out of the frames. float64 like `motion`; NaN in cells that
    are known in fewer than `OFTEN` of the frames.
    """
    values = np.concatenate([np.zeros((1, *motion.shape[1:])), motion])
    known = np.isfinite(values)
    often, result = known.mean(0) >= OFTEN, np.full(motion.shape, np.nan)
    values, known, held_out = values[:, often], known[:, often], _held_out(values.shape)[:, often] & known[:, often]
    if len(motion) > 2 and held_out.any():
        errors = [np.square(_completed(values, known & ~held_out, rank) - values)[held_out].mean() for rank in range(COURSES + 1)]
        completed = _completed(values, known, int(np.argmin(errors)))
        result[:, often] = completed[1:] - completed[0]
    return result


def _held_out(shape: tuple[int, ...]) -> np.ndarray:
    """One block of `BLOCK` cells' side a frame, bool [T, rows, columns]: held out where the number of courses is asked for."""
    random, held = np.random.default_rng(0), np.zeros(shape, bool)
    for frame in held:
        row, column = (int(random.integers(max(1, n - BLOCK + 1))) for n in frame.shape)
        frame[row : row + BLOCK, column : column + BLOCK] = True
    return held


def _completed(values: np.ndarray, known: np.ndarray, rank: int) -> np.ndarray:
    """Values [T, P] as each place's mean and `rank` courses over time that all places share, by those that are `known`."""
    completed = np.broadcast_to(np.where(known, values, 0).sum(0) / np.maximum(known.sum(0), 1), values.shape)
    courses = np.random.default_rng(0).standard_normal((len(values), rank))
    for _ in range(ROUNDS if rank else 0):
        filled = np.where(known, values, completed)
        mean = filled.mean(0)
        moved = filled - mean
        courses, _ = np.linalg.qr(moved @ (moved.T @ courses))  # towards the largest singular vectors, which the rounds find together
        completed = mean + courses @ (courses.T @ moved)
    return completed
