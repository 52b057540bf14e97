"""Flow supervision: optical flow between training frames, from which motion is learned.

A photometric loss alone lets Gaussians fade and change colour in place. Flow shows where each visible point went.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import tee
from typing import TypeAlias

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.latest import Latest
from degense.engine.motion import chain, consistent, flow_error, follow, normalized, sample, steps_between
from degense.engine.motion.constancy import around, log_intensity, looks_changed
from degense.engine.motion.depth_noise import depth_changes, depth_error
from degense.engine.progress import Progress, silent
from degense.engine.raster.camera_tensors import view_and_lens
from degense.engine.training.frames import TrainingFrames

FLOW_PIXELS = 100_000
# Of flow kept: a long clip's is measured on smaller frames. Four pairs a frame, six bytes each, two that are completed, eight each, and the
# motion along the line of sight, two.
PAIR_BYTES, BYTES_A_PIXEL = 3 << 28, 42
WINDOW = 8  # training frames before and after one, in which its look must stay the same
DEPTH_HALF = 0.0033  # of the scene's depth: depth that errs by so much from frame to frame tells half of what it would without error
DEPTH_FRAMES = 16  # of a clip, evenly spread, that tell how much its depth errs
LEAST_ERROR = 0.15  # pixels of the flow's size: error that flow has where noise makes none
STEADY = 0.15  # of the depth: what changes its depth by more from frame to frame was taken for something else


#: Flow there and back between a frame and the next, and between the first frame and that next one.
MeasuredFlow: TypeAlias = tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def measure_flow(frames: Sequence[np.ndarray]) -> Iterator[MeasuredFlow]:
    """The flow of all frames but the last, uint8 [h, w, 3], in order."""
    neighbours, steps = tee(steps_between(frames, grey=normalized))
    return zip(neighbours, follow(frames, steps, normalized), strict=True)


@dataclass
class Pair:
    """Where the pixels of one frame went in another."""

    to: int  # the other frame
    flow: Tensor  # float16 [2, h, w]; fractions of the image's width and height
    weight: Tensor  # float16 [1, h, w]; 1 where the flow is consistent forwards and backwards and both ends are valid, else 0
    #: float16 [1, h, w]; how much it counts for a loss (`precision_of`), by the error that noise makes (`engine.motion.flow_error`)
    precision: Tensor


class FlowSupervision:
    """Flow of every training frame to its neighbours and to the first training frame, computed once.

    Neighbours are matched directly, which is exact for small motion; the way to the first frame is followed from frame to frame, since a
    direct match of far frames passes the forward-backward check while being wrong by many pixels.

    `tools` are the pixels of a training frame that a teacher calls an instrument, bool [H, W] at the working size, None where it does not
    say: they are no tissue. Without it only what the clip itself masks is left out, and that flow forwards and backwards must agree is all
    that keeps the motion of an instrument from the tissue beside it.
    """

    #: What measures the flow; research shares it between trainings.
    measure: Callable[[Sequence[np.ndarray]], Iterator[MeasuredFlow]] = staticmethod(measure_flow)

    def __init__(
        self,
        frames: TrainingFrames,
        progress: Progress = silent,
        tools: Callable[[int], np.ndarray | None] | None = None,
        *,
        constancy: bool = True,
        precision: bool = True,
        depth_precision: bool = True,
    ):
        self.frames = frames
        width, height = frames.size
        train = frames.clip.train_frames
        pixels = min(FLOW_PIXELS, PAIR_BYTES // (BYTES_A_PIXEL * len(train)))
        shrink = min(1.0, (pixels / (width * height)) ** 0.5)
        self.size = max(12, round(width * shrink)), max(12, round(height * shrink))
        with ThreadPoolExecutor() as pool:
            small = list(pool.map(self.image, train))
            precise = list(pool.map(lambda frame: precision_of(flow_error(frame)) if precision else np.ones(frame.shape[:2]), small))
        seen = {} if tools is None else {i: tool for i in train if (tool := tools(i)) is not None}
        tissue = [self._inside(frames.valid(i) & ~seen[i] if i in seen else frames.valid(i)) for i in train]
        on_device = [torch.from_numpy(values[None]).to(frames.device).half() for values in precise]
        self.tissue = dict(zip(train, tissue, strict=True))
        #: Of each training frame, as `Pair.precision` of its pairs that were measured.
        self.precision = dict(zip(train, on_device, strict=True))
        self.pairs: dict[int, list[Pair]] = {i: [] for i in train}
        #: Pairs that teach more than was measured, by their two frames (`engine.training.flow.inferred`).
        self.completed: dict[tuple[int, int], Pair] = {}

        found: list[tuple[int, Future[Pair]]] = []
        with ThreadPoolExecutor() as pool:
            for k, (step, far) in enumerate(self.measure(small)):
                progress(k / len(train), "following tissue through the clip")
                # the second frame is the first one's neighbour
                for a, (there, back) in ((k, step), (0, far)) if k else ((0, step),):
                    for here, to, forward, backward in ((a, k + 1, there, back), (k + 1, a, back, there)):
                        ends = tissue[here], tissue[to], on_device[here]
                        found.append((train[here], pool.submit(self._matched, train[to], forward, backward, *ends)))
        for frame, pair in found:
            self.pairs[frame].append(pair.result())
        if constancy:
            self._drop_changed(small)
        #: How much measured depth counts: 1 / (1 + (σ / `DEPTH_HALF`)²), σ the clip's `depth_error`; 0 where none was measured.
        self.depth_precision = 0.0
        if frames.clip.depth_measured:
            self.depth_precision = 1 / (1 + (self._depth_error() / DEPTH_HALF) ** 2) if depth_precision else 1.0
        self._trust = torch.tensor(self.depth_precision, device=frames.device)
        #: `motion_along_sight` by frame, float16 [h, w], where it is asked for (`engine.training.flow.along_sight`).
        self.along_sight: dict[int, Tensor] = {}

    def image(self, frame: int) -> np.ndarray:
        """A frame at the size of the flow, uint8 [h, w, 3]."""
        return cv2.resize(self.frames.image(frame), self.size, interpolation=cv2.INTER_AREA)

    def _drop_changed(self, small: list[np.ndarray]) -> None:
        """Take away the weight of flow where tissue changes its look: what charring or blood seems to move has not moved.

        A pair with the first frame loses it where its two ends differ; a pair of neighbours where the look changes along the consistent
        way through up to `WINDOW` frames before or after.
        """
        train = self.frames.clip.train_frames
        logs, kept = [log_intensity(frame) for frame in small], Latest(16 * WINDOW)  # neighbours read the same pairs

        def pair_of(here: int, there: int) -> tuple[np.ndarray, np.ndarray]:
            return kept.get((here, there), lambda: (self.seen(here, there).astype(np.float32), self.flow(here, there)))

        with ThreadPoolExecutor() as pool:
            changing = list(pool.map(lambda k: around(self._changes(k, logs, pair_of)), range(len(train))))
        for k, frame in enumerate(train):
            for pair in self.pairs[frame]:
                other = train.index(pair.to)
                flow = _relative(pair) * np.array(self.size, np.float32)
                if 0 in (k, other) and abs(other - k) > 1:
                    spoiled = around(looks_changed(logs[k], logs[other], flow))
                else:
                    spoiled = changing[k] | (sample(changing[other].astype(np.float32), flow) > 0.01)
                pair.weight.mul_(torch.from_numpy(~spoiled[None]).to(pair.weight.device))

    def _depth_error(self) -> float:
        """Standard deviation of the measured depth of one frame, in scene units; of some frames, where the flow is consistent."""
        train = self.frames.clip.train_frames
        middle = np.unique(np.linspace(1, len(train) - 2, min(DEPTH_FRAMES, max(0, len(train) - 2))).astype(int))
        return depth_error(np.array([self._depth_changes(*train[k - 1 : k + 2]) for k in middle]))

    def _depth_changes(self, before: int, here: int, after: int) -> np.ndarray:
        """`depth_changes` of three training frames in a row, NaN where the flow is not consistent."""
        first, middle, last = (cv2.resize(self.frames.depth(i), self.size, interpolation=cv2.INTER_NEAREST) for i in (before, here, after))
        changes = depth_changes(first, middle, last, self.flow(here, before), self.flow(here, after))
        for other in (before, after):
            pair = self.pair(here, other)
            assert pair is not None
            changes[pair.weight[0].float().cpu().numpy() < 0.5] = np.nan
        return changes

    def _changes(self, k: int, logs: list[np.ndarray], pair_of: Callable[[int, int], tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Where the look of training frame number `k` changes, followed through its neighbours, bool [h, w]; `pair_of` two frames are where
        their flow has weight, float32 [h, w], and their flow."""
        train, changed = self.frames.clip.train_frames, np.zeros(logs[k].shape[:2], bool)
        for direction in (1, -1):
            flow, followed = np.zeros((*changed.shape, 2), np.float32), np.ones(changed.shape, bool)
            for step in range(1, WINDOW + 1):
                here, there = k + direction * (step - 1), k + direction * step
                if not 0 <= there < len(train):
                    break
                sure, step_flow = pair_of(train[here], train[there])
                followed &= sample(sure, flow) > 0.5
                flow = chain(flow, step_flow)
                if step & (step - 1) == 0:  # 1, 2, 4, 8: what changes slowly shows in the long steps
                    changed |= followed & looks_changed(logs[k], logs[there], flow)
        return changed

    def _inside(self, valid: np.ndarray) -> np.ndarray:
        """Valid pixels at flow size, away from the edge of a tool mask, whose motion bleeds into the tissue beside it."""
        small = cv2.resize(valid.astype(np.uint8), self.size, interpolation=cv2.INTER_NEAREST)
        return cv2.erode(small, np.ones((7, 7), np.uint8), borderValue=1) > 0

    def _matched(self, to: int, forward: np.ndarray, backward: np.ndarray, here: np.ndarray, there: np.ndarray, precision: Tensor) -> Pair:
        """The pair of a frame whose tissue is `here` with the frame `to`, where it is `there`, bool [h, w]."""
        weight = here & (sample(there.astype(np.float32), forward) > 0.99) & consistent(forward, backward)
        relative = np.moveaxis(forward / np.array(self.size, np.float32), -1, 0).copy()
        flow, sure = (torch.from_numpy(array).to(self.frames.device).half() for array in (relative, weight[None]))
        return Pair(to, flow, sure, precision)

    def warped(self, values: np.ndarray, source: int, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Values of one training frame, warped to where its tissue is in another, by way of the first training frame.

        The nearest pixels of the source, [H, W] or [H, W, C] at the working size, and bool [H, W] where flow could say which; elsewhere as
        the nearest pixel where it could.
        """
        first = self.frames.clip.train_frames[0]
        known = np.ones(values.shape[:2], bool)
        for here, there in ((first, source), (frame, first)):
            pair = self.pair(here, there)
            if pair is None:
                known &= here == there
                continue
            width, height = self.frames.size
            flow = cv2.resize(_relative(pair), (width, height)) * np.array([width, height], np.float32)
            sure = cv2.resize(pair.weight[0].float().cpu().numpy(), (width, height)) > 0.5
            flow = from_nearest(flow, sure)
            x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
            x, y = x + flow[..., 0], y + flow[..., 1]
            values = cv2.remap(values, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
            known = sure & (cv2.remap(known.astype(np.uint8), x, y, cv2.INTER_NEAREST, borderValue=0) > 0)
        return values, known

    def velocity(self, frame: int, pixels: np.ndarray) -> np.ndarray:
        """How fast what is seen at `pixels` [n, 2] of a training frame moves, instruments included, float64 [n, 3].

        In scene units in a unit of the clip's time, of pixels (x, y) at the working size: the mean over the neighbouring training frames to
        which the flow is consistent and the depth steady; 0 where there is none. A depth that was not measured is taken to stay as it is.
        """
        train, clip = self.frames.clip.train_frames, self.frames.clip
        size, (rows, columns) = np.array(self.frames.size), pixels[:, ::-1].astype(int).T
        depth = self.frames.depth(frame)[rows, columns]
        start = self.frames.cameras[frame].unproject(pixels, depth)
        total, count = np.zeros((len(pixels), 3)), np.zeros(len(pixels))
        number = train.index(frame)
        for other in train[max(0, number - 1) : number] + train[number + 1 : number + 2]:
            forward, backward = self.flow(frame, other), self.flow(other, frame)
            at = (pixels * np.array(self.size) / size).astype(np.float32)[None]
            sure = cv2.remap(consistent(forward, backward).astype(np.uint8), at, None, cv2.INTER_NEAREST)[0] > 0
            end = pixels + cv2.remap(forward, at, None, cv2.INTER_LINEAR)[0] * size / np.array(self.size)
            inside = np.all((end >= 0) & (end < size), axis=1)
            row, column = np.clip(end[:, ::-1].astype(int), 0, size[::-1] - 1).T
            there = self.frames.depth(other)[row, column] if clip.depth_measured else depth
            steady = (there > 0) & (np.abs(there - depth) < STEADY * depth)
            reliable = sure & inside & steady
            believed = np.where(reliable, depth + self.depth_precision * (there - depth), depth)
            moved = self.frames.cameras[other].unproject(end, believed) - start
            total += np.where(reliable[:, None], moved / (clip.time(other) - clip.time(frame)), 0)
            count += reliable
        return total / np.maximum(count, 1)[:, None]

    def pair(self, here: int, there: int) -> Pair | None:
        """The pair of two training frames, if they were matched."""
        return next((pair for pair in self.pairs.get(here, []) if pair.to == there), None)

    def seen(self, here: int, there: int) -> np.ndarray:
        """Where the flow of a pair has weight, bool [h, w]."""
        pair = self.pair(here, there)
        assert pair is not None
        return pair.weight[0].cpu().numpy() > 0.5

    def flow(self, here: int, there: int) -> np.ndarray:
        """Flow between two frames of a pair, float32 [h, w, 2], pixels of the flow's size."""
        pair = self.pair(here, there)
        assert pair is not None
        return _relative(pair) * np.array(self.size, np.float32)

    def inputs(self, frame: int, pair: Pair) -> tuple[Tensor, ...]:
        """What `motion_error` needs to know of a pair, beside the model's own motion: tensors of the same shapes for every pair."""
        pair = self.completed.get((frame, pair.to), pair)
        camera, other = (view_and_lens(self.frames.cameras[i], self.frames.device) for i in (frame, pair.to))
        measured = self.frames.clip.depth_measured
        depths = (self.frames[frame].depth, self.frames[pair.to].depth) if measured else ()
        gone = (self.along_sight[frame], self.along_sight[pair.to]) if self.along_sight else ()
        return (camera, other, pair.flow, pair.weight, pair.precision, self._trust, *depths, *gone)


def precision_of(error: np.ndarray) -> np.ndarray:
    """How much flow counts that errs by σ pixels beside what all flow errs by: 1 / √(1 + (σ / `LEAST_ERROR`)²), float [H, W].

    The loss grows with the distance, not with its square: the likelihood of a distance e is then e^(−e / b), b proportional to its
    standard deviation, and its weight is 1 / b.
    """
    return 1 / np.sqrt(1 + (error / LEAST_ERROR) ** 2)


def from_nearest(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values [H, W] or [H, W, C]; where they are not known (bool [H, W]) those of the nearest known pixel, if there is any."""
    if not known.any() or known.all():
        return values
    _, labels = cv2.distanceTransformWithLabels((~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    value = np.zeros((labels.max() + 1, *values.shape[2:]), values.dtype)
    value[labels[known]] = values[known]
    return value[labels]


def _relative(pair: Pair) -> np.ndarray:
    """A pair's flow as float32 [h, w, 2], fractions of the image's width and height."""
    return pair.flow.float().cpu().numpy().transpose(1, 2, 0)
