"""The votes that decide propagation.

Of optical flow: labels warped along the recording, for thin and fast things that the 4D field does not hold. Of the 4D field: labels
back-projected to the Gaussians, which are drawn at other times. Of appearance: colour and texture around a pixel of each class, learned
anew from the corrected frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from degense.engine.annotation.edits import pack, unpack
from degense.engine.clip import Clip
from degense.engine.motion import consistent, follow, sample
from degense.engine.raster import backproject, rasterize
from degense.engine.scene import Scene
from degense.engine.scene.labelled import LabelledPlaces
from degense.engine.semantics.novelty import Novelty, surroundings, surroundings_by_class
from degense.engine.store.run import LabelSupport
from degense.engine.threads import one_torch_thread
from degense.engine.training.adam import Adam
from degense.engine.training.semantic.label_support import shown_by

#: Weight of a label that was warped where forward and backward flow disagree.
INCONSISTENT = 0.2


def nearness(frame: int, sources: Sequence[int]) -> np.ndarray:
    """Weights of corrected frames at another frame, float32 [n], ∝ 1 / d² with d the distance in frames; their sum is 1."""
    distance = np.abs(np.asarray(sources, np.float32) - frame)
    weights = 1 / np.maximum(distance, 0.5) ** 2
    return (weights / weights.sum()).astype(np.float32)


class FlowVotes:
    """Label maps of the corrected frames, warped to every frame up to the next corrected one. Call `measure` to the end before asking.

    `labels` int64 [H, W] by frame are 0 … count − 1; votes are wanted for `frames`, ascending, without gaps.
    """

    def __init__(self, clip: Clip, labels: Mapping[int, np.ndarray], count: int, frames: Sequence[int]):
        self._clip, self._labels, self._count = clip, labels, count
        self._shape = clip.size[1], clip.size[0]
        self._spans = list(spans(sorted(labels), frames[0], frames[-1]))
        self._moved: dict[int, dict[int, tuple[bytes, ...]]] = {}

    @property
    def steps(self) -> int:
        """How many pairs of frames `measure` compares."""
        return sum(len(span) - 1 for span in self._spans)

    def measure(self) -> Iterator[int]:
        """Follow the flow; yields after each step the frame that was reached."""
        for span in self._spans:
            labels, first = self._labels[span[0]].astype(np.uint8), _lab(self._clip.frame(span[0]))
            reached = follow(self._clip.frame(i) for i in span)
            for frame, (out, back) in zip(span[1:], reached, strict=True):
                moved, inside = warped_labels(labels, back)
                agrees = consistent(back, out) & inside
                unlike = np.linalg.norm(sample(first, back) - _lab(self._clip.frame(frame)), axis=-1)
                coded = np.nan_to_num(2 * unlike, nan=255).clip(0, 255).astype(np.uint8)
                self._moved.setdefault(frame, {})[span[0]] = pack(moved), pack(agrees), pack(coded), pack(inside)
                yield frame

    def at(self, frame: int) -> np.ndarray:
        """Weights of the labels in each pixel, float32 [H, W, count], at most 1."""
        found = self._moved.get(frame, {})
        votes = np.zeros((*self._shape, self._count), np.float32)
        for weight, (moved, agrees, *_) in zip(nearness(frame, list(found)) if found else (), found.values(), strict=True):
            certain = np.where(unpack(agrees, self._shape), 1.0, INCONSISTENT).astype(np.float32) * weight
            index = unpack(moved, self._shape)[..., None].astype(np.int64)
            np.put_along_axis(votes, index, np.take_along_axis(votes, index, -1) + certain[..., None], -1)
        return votes

    def traces(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """How unlike a pixel is to the one that the flow finds for it (CIELAB, at most 127), and whether it is found at all.

        float32 and bool [H, W], over the corrected frames on both sides: the more like one counts.
        """
        found = [(unpack(unlike, self._shape), unpack(agrees, self._shape)) for _, agrees, unlike, _ in self._moved[frame].values()]
        return np.min([unlike for unlike, _ in found], 0).astype(np.float32) / 2, np.max([agrees for _, agrees in found], 0) > 0

    def outside(self, frame: int) -> np.ndarray:
        """Whether the flow leads out of the picture in every corrected frame that it was followed to, bool [H, W]."""
        return ~np.logical_or.reduce([unpack(inside, self._shape) > 0 for *_, inside in self._moved[frame].values()])


def spans(sources: Sequence[int], first: int, last: int) -> Iterator[list[int]]:
    """From each corrected frame forwards and backwards, up to but not including the next corrected frame or beyond the ends."""
    for before, here, after in zip([None, *sources[:-1]], sources, [*sources[1:], None], strict=True):
        forwards = list(range(here, min(last, after - 1 if after is not None else last) + 1))
        backwards = list(range(here, max(first, before + 1 if before is not None else first) - 1, -1))
        for span in (forwards, backwards):
            if len(span) > 1:
                yield span


def warped_labels(labels: np.ndarray, back: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels uint8 [H, W] seen where a flow float32 [H, W, 2] from the other frame leads (nearest pixel), and where it stays inside."""
    height, width = labels.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x, y = x + back[..., 0], y + back[..., 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    column = np.clip(np.nan_to_num(x).round(), 0, width - 1).astype(np.intp)
    row = np.clip(np.nan_to_num(y).round(), 0, height - 1).astype(np.intp)
    return labels[row, column], inside


#: Total share of pixels below which a Gaussian counts little.
LEAST_SEEN = 0.1
#: Mean difference in colour (0 to 1) between the rendered and the recorded pixel at which a vote counts 1/e.
UNLIKE = 0.15


class FieldVotes:
    """Votes of the Gaussians of a scene that has the frames and the size of the label maps.

    `labels` int64 [H, W] by frame are 0 … count − 1; `valid` bool [H, W] by frame are the pixels that the scene reconstructs.
    """

    def __init__(self, scene: Scene, labels: Mapping[int, np.ndarray], valid: Mapping[int, np.ndarray], count: int):
        self._scene = scene
        self._seen = {frame: self._backproject(frame, labels[frame], valid[frame], count) for frame in labels}
        self._valid = valid

    def _backproject(self, frame: int, labels: np.ndarray, valid: np.ndarray, count: int) -> Tensor:
        """Σ_p w_ip [L(p) = k] over the valid pixels of a frame, [N, count]; w_ip is the share of Gaussian i in pixel p."""
        splats = self._scene.splats(frame)
        named = torch.nn.functional.one_hot(torch.from_numpy(labels), count) * torch.from_numpy(valid)[..., None]
        return backproject(splats, named.to(splats.means), self._scene.camera(frame), clean=True).total

    @torch.no_grad()
    def at(self, frame: int, observed: np.ndarray) -> np.ndarray:
        """Shares of the labels in each pixel, float32 [H, W, count], less where the recorded frame, uint8 [H, W, 3], looks different."""
        weights = nearness(frame, list(self._seen))
        total = sum(weight * seen for weight, seen in zip(weights, self._seen.values(), strict=True))
        assert isinstance(total, Tensor)
        shares = total / (total.sum(1, keepdim=True) + LEAST_SEEN)
        splats = self._scene.splats(frame)
        features = torch.cat([shares, splats.colors], 1)
        drawn = rasterize(splats, features, self._scene.camera(frame), clean=True)
        image = drawn.image.cpu().numpy()
        unlike = np.abs(image[..., -3:].clip(0, 1) - observed.astype(np.float32) / 255).mean(-1)
        return image[..., :-3] * np.exp(-((unlike / UNLIKE) ** 2))[..., None]

    @cached_property
    def _places(self) -> LabelledPlaces:
        scene = self._scene
        shown = shown_by(scene.splats, scene.cameras, self._valid, range(scene.frames))
        return LabelledPlaces(scene.states, LabelSupport(shown, torch.zeros_like(shown), list(self._valid)), scene.cameras)

    def outside(self, frame: int) -> np.ndarray:
        """Which pixels show a place that no corrected frame shows, bool [H, W]."""
        return ~self._places.pixels(frame, self._scene.camera(frame)).cpu().numpy()


SAMPLES = 1500  # pixels of each class and corrected frame to learn from
WIDTH, STEPS, BATCH, RATE, DECAY, SMOOTHING = 32, 300, 2048, 1e-2, 1e-3, 0.1

#: Logistic weights of `unknown_evidence`, the constant first; fitted to 24 surgeries of the family, seeds 0 to 31.
UNKNOWN = (-8.3, 1.7, 2.3, 1.6)
BLUR = 2.0  # of it, pixels


class AppearanceVotes:
    """A small network from the surroundings of a pixel to its class.

    Learned from frames, uint8 [H, W, 3], and their labels, int64 [H, W], 0 … count − 1.
    """

    def __init__(self, pictures: Sequence[np.ndarray], labels: Sequence[np.ndarray], count: int, seed: int = 0):
        inputs, targets = _samples(pictures, labels, np.random.default_rng(seed))
        self._present = np.bincount(targets, minlength=count) > 0
        #: How far the surroundings of each pixel of a picture are from all that were learned from.
        self.novelty = Novelty(inputs, seed)
        with one_torch_thread(1):
            self._network = _fitted(self.novelty.scaled(inputs), targets, count, seed)

    @torch.no_grad()
    def at(self, rgb: np.ndarray) -> np.ndarray:
        """Probabilities of the classes, float32 [H, W, count]; 0 for classes that no corrected frame has."""
        x = self.novelty.scaled(surroundings(rgb))
        with one_torch_thread(1):
            scores = self._network(x)
        scores[:, ~torch.from_numpy(self._present)] = -torch.inf
        return torch.softmax(scores, 1).numpy().reshape(*rgb.shape[:2], -1)


def unknown_evidence(novelty: np.ndarray, unlike: np.ndarray, found: np.ndarray) -> np.ndarray:
    """What speaks for a pixel showing what no corrected frame shows, float32 [3, H, W].

    Logarithms of `AppearanceVotes.novelty` and of the unlikeness of `FlowVotes.traces`, by its median, and where that is not found.
    """
    maps = np.log(novelty + 1e-3), np.log((1 + unlike) / (1 + np.median(unlike))), np.where(found, 0.0, 1.0)
    return np.stack([cv2.GaussianBlur(values.astype(np.float32), (0, 0), BLUR) for values in maps])


def unknown_chance(evidence: np.ndarray) -> np.ndarray:
    """The chance of it, float32 [H, W]."""
    bias, *weights = UNKNOWN
    return 1 / (1 + np.exp(-bias - np.tensordot(np.array(weights, np.float32), evidence, 1)))


def _lab(rgb: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)


def _samples(pictures: Sequence[np.ndarray], labels: Sequence[np.ndarray], random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Surroundings float32 [n, 13] and classes int64 [n] of some pixels of each class in each picture."""
    drawn = (surroundings_by_class(rgb, wanted, SAMPLES, random) for rgb, wanted in zip(pictures, labels, strict=True))
    found = [item for by_class in drawn for item in by_class.items()]
    return np.concatenate([values for _, values in found]), np.concatenate([np.full(len(values), label) for label, values in found])


def _fitted(x: Tensor, targets: np.ndarray, count: int, seed: int) -> nn.Module:
    y = torch.from_numpy(targets)
    counts = torch.bincount(y, minlength=count).float()
    weights = torch.where(counts > 0, counts.clamp_min(1) ** -0.5, 0)  # rare classes count more, but not as much as common ones
    loss = nn.CrossEntropyLoss(weight=weights / weights.sum() * (counts > 0).sum(), label_smoothing=SMOOTHING)
    with torch.random.fork_rng(devices=[]), torch.enable_grad():
        torch.manual_seed(seed)
        network = nn.Sequential(nn.Linear(x.shape[1], WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH), nn.ReLU(), nn.Linear(WIDTH, count))
        optimizer = Adam([{"params": network.parameters(), "lr": RATE}], decay=DECAY)
        for step in range(STEPS):
            for group in optimizer.param_groups:
                group["lr"] = RATE * (1 - step / STEPS) + RATE / 100
            batch = torch.randint(len(x), (BATCH,))
            optimizer.zero_grad()
            loss(network(x[batch]), y[batch]).backward()
            optimizer.step()
    return network.requires_grad_(False)
