"""Semantic supervision: what a teacher says of each training frame, in the latent space of a basis."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

from engine.errors import DegenseError
from engine.language import Basis, Teacher, fit_basis
from engine.masks.superpixels import superpixels
from engine.progress import Progress, silent
from engine.training.evidence import MotionEvidence
from engine.training.frames import TrainingFrames
from engine.training.losses import angular, region_smoothness

SPARSE = 0.25  # a teacher that speaks about a smaller share of the training frames has its words carried to the others

TARGET_BYTES = 1 << 30  # of supervision kept
PIXEL_BYTES = 16  # of one pixel's


@dataclass
class Target:
    """Supervision of one frame.

    Attributes
    ----------
    latents : float [k, d]
        The vectors the teacher used here, projected to the basis.
    index : int32 [P]
        Which of them each spoken-for pixel has.
    pixels : int32 [P]
        Flat positions of those pixels.
    weight : float [P]
        Rare vectors weigh more, with the square root of their rarity, so that thin instruments are not drowned by tissue. Mean 1.
    regions : int32 [H × W]
    region_count : int
    """

    latents: Tensor
    index: Tensor
    pixels: Tensor
    weight: Tensor
    regions: Tensor
    region_count: int


class SemanticTargets:
    """All supervision of a clip. That of a frame is made when it is needed and kept while there is room: a long clip's would not fit.

    Attributes
    ----------
    basis : Basis
    frames : list of int
        Frames that have a target.
    spoken : list of int
        Those the teacher itself speaks about; the others got its words along the optical flow.
    """

    def __init__(self, teacher: Teacher, frames: TrainingFrames, evidence: MotionEvidence | None = None, progress: Progress = silent):
        self._teacher, self._working, self._evidence = teacher, frames, evidence
        clip = frames.clip
        candidates = sorted(set(clip.train_frames) | set(clip.labelled_frames))
        self.spoken: list[int] = []
        vectors, counts = [], []
        for done, i in enumerate(candidates):
            progress(0.5 * done / len(candidates), "asking the teacher")
            if (answer := self._words(i)) is not None:
                self.spoken.append(i)
                vectors.append(answer[0])
                counts.append(np.bincount(answer[1][answer[1] >= 0], minlength=len(answer[0])))
        if not self.spoken:
            raise DegenseError(
                f"{clip.path}: the teacher {teacher.name!r} says nothing about any training frame; "
                "train with --teacher none or add label maps"
            )
        self.basis: Basis = fit_basis(np.concatenate(vectors), np.concatenate(counts).astype(np.float64))
        self._source = {i: i for i in self.spoken}
        if evidence is not None and len(self.spoken) < SPARSE * len(clip.train_frames):
            for done, i in enumerate(clip.train_frames):
                progress(0.5 + 0.5 * done / len(clip.train_frames), "carrying labels along with the tissue")
                source = min(self.spoken, key=lambda s: abs(s - i))
                if i not in self._source and (self._said(i, source)[1] >= 0).any():
                    self._source[i] = source
        self.frames = sorted(self._source)
        self._kept: OrderedDict[int, Target] = OrderedDict()
        width, height = frames.size
        self._capacity = max(2, TARGET_BYTES // (width * height * PIXEL_BYTES))

    def _words(self, frame: int) -> tuple[np.ndarray, np.ndarray] | None:
        """What the teacher itself says of a frame, if anything."""
        answer = self._teacher.targets(frame)
        if answer is None:
            return None
        vectors, index = _directed(*answer)
        return (vectors, index) if (index >= 0).any() else None

    def _said(self, frame: int, source: int) -> tuple[np.ndarray, np.ndarray]:
        """The vectors that `source` has, and which of them each pixel of `frame` should have, int32 at the working size, −1 where none.

        Words of another frame are moved with the tissue, where flow knows how it moved.
        """
        answer = self._words(source)
        assert answer is not None
        vectors, index = answer
        frames = self._working
        small = cv2.resize(index.astype(np.float32), frames.size, interpolation=cv2.INTER_NEAREST).astype(np.int32)
        small = np.where(frames.valid(source), small, -1)
        if source != frame:
            assert self._evidence is not None
            moved, known = self._evidence.carried(small, source, frame)
            small = np.where(known & frames.valid(frame), moved, -1)
        return vectors, small.astype(np.int32)

    def target(self, frame: int) -> Target:
        """The supervision of one of `frames`."""
        if frame in self._kept:
            self._kept.move_to_end(frame)
            return self._kept[frame]
        target = self._target(frame, *self._said(frame, self._source[frame]))
        self._kept[frame] = target
        if len(self._kept) > self._capacity:
            self._kept.popitem(last=False)
        return target

    def _target(self, frame: int, vectors: np.ndarray, index: np.ndarray) -> Target:
        flat = index.ravel()
        pixels = np.flatnonzero(flat >= 0).astype(np.int32)
        chosen = flat[pixels]
        counts = np.bincount(chosen, minlength=len(vectors)).astype(np.float64)
        weight = 1 / np.sqrt(np.maximum(counts[chosen], 1))
        weight /= max(weight.mean(), 1e-12) if len(weight) else 1
        regions = superpixels(self._working.image(frame))
        device = self._working.device
        return Target(
            torch.from_numpy(self.basis.project(vectors)).float().to(device),
            torch.from_numpy(chosen).to(device),
            torch.from_numpy(pixels).to(device),
            torch.from_numpy(weight).float().to(device),
            torch.from_numpy(regions.ravel()).to(device),
            int(regions.max()) + 1,
        )

    def loss(self, latent: Tensor, frame: int, *, use_angles: bool, region_weight: float) -> Tensor:
        """L_align (Eq. 3, or L1 for the coupled baseline) + w·L_smooth on a drawn latent map [H, W, d]."""
        target = self.target(frame)
        flat = latent.reshape(-1, latent.shape[-1])
        predicted, wanted = flat[target.pixels], target.latents[target.index]
        error = angular(predicted, wanted) if use_angles else (predicted - wanted).abs().sum(-1)
        loss = (error * target.weight).sum() / max(len(target.pixels), 1)
        if region_weight > 0:
            loss = loss + region_weight * region_smoothness(flat, target.regions, target.region_count)
        return loss


def _directed(vectors: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A teacher's vectors as float32 of unit length, whatever precision and length they came in; zero and non-finite ones say nothing."""
    vectors = np.asarray(vectors, np.float64)  # squares of float16 and float32 must not overflow
    length = np.linalg.norm(vectors, axis=1)
    sound = np.isfinite(length) & (length > 0)
    unit = np.where(sound[:, None], vectors, 0.0) / np.where(sound, length, 1.0)[:, None]
    return unit.astype(np.float32), np.where((index >= 0) & sound[index], index, -1).astype(np.int32)
