"""Semantic supervision: what a teacher says of each training frame, in the latent space of a basis."""

from __future__ import annotations

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
from engine.training.guided import refined_by_regions
from engine.training.losses import angular, region_smoothness

SPARSE = 0.25  # a teacher that speaks about a smaller share of the training frames has its words carried to the others
LIKE = 8  # power of the cosine with which vectors count as saying the same
BASIS_VECTORS = 20_000  # of all frames' vectors, that the basis is fitted to

Spoken = dict[int, tuple[np.ndarray, np.ndarray]]


@dataclass
class Target:
    """Supervision of one frame.

    Attributes
    ----------
    latents : float [k, d]
        The vectors the teacher used here, projected to the basis.
    index : int64 [P]
        Which of them each spoken-for pixel has.
    pixels : int64 [P]
        Flat positions of those pixels.
    weight : float [P]
        What is rarely said weighs more, with the square root of its rarity, so that thin instruments are not drowned by tissue. Mean 1.
    regions : int64 [H × W]
    region_count : int
    """

    latents: Tensor
    index: Tensor
    pixels: Tensor
    weight: Tensor
    regions: Tensor
    region_count: int


class SemanticTargets:
    """All supervision of a clip.

    Parameters
    ----------
    teacher : Teacher
        Asked about its own frames only, so held-out frames stay held out.
    frames : TrainingFrames
    evidence : MotionEvidence, optional
        Carries the words of a teacher that speaks about few frames to the others.
    progress : Progress
    guided : bool
        Whether the vectors of a coarse teacher are shared out over the picture's superpixels (`refined_by_regions`).
    max_rank : int

    Attributes
    ----------
    basis : Basis
    frames : list of int
        Frames that have a target.
    spoken : list of int
        Those the teacher itself speaks about; the others got its words along the optical flow.
    """

    def __init__(
        self,
        teacher: Teacher,
        frames: TrainingFrames,
        evidence: MotionEvidence | None = None,
        progress: Progress = silent,
        *,
        guided: bool = True,
        max_rank: int = 32,
    ):
        spoken: Spoken = {}
        clip = frames.clip
        self._regions: dict[int, np.ndarray] = {}
        for done, i in enumerate(teacher.frames):
            progress(0.7 * done / len(teacher.frames), "asking the teacher")
            if (answer := teacher.targets(i)) is not None and (answer[1] >= 0).any():
                vectors, index = answer[0], self._reduced(frames, i, answer[1])
                if guided and not teacher.pixelwise:
                    regions = self._superpixels(frames, i)
                    vectors = refined_by_regions(vectors, index, frames.image(i), regions)
                    index = np.where((index >= 0) & (np.linalg.norm(vectors, axis=1)[regions] > 0), regions, -1)
                spoken[i] = vectors, index
        if not spoken:
            raise DegenseError(
                f"{clip.path}: the teacher {teacher.name!r} says nothing about any training frame; "
                "train with --teacher none or add label maps"
            )
        anchors = None if teacher.pixelwise or not clip.classes else teacher.encoder.encode(clip.classes)
        self.basis: Basis = _basis(spoken, anchors, max_rank)
        self._targets: dict[int, Target] = {}
        for done, (i, (vectors, index)) in enumerate(spoken.items()):
            progress(0.7 + 0.1 * done / len(spoken), "finding superpixels")
            self._targets[i] = self._target(frames, i, vectors, index)
        if evidence is not None and len(spoken) < SPARSE * len(clip.train_frames):
            self._carry(spoken, frames, evidence, progress)
        self._regions.clear()
        self.frames = sorted(self._targets)
        self.spoken = sorted(spoken)

    def __getitem__(self, frame: int) -> Target:
        return self._targets[frame]

    def _carry(self, spoken: Spoken, frames: TrainingFrames, evidence: MotionEvidence, progress: Progress) -> None:
        """Give every silent training frame the words of the nearest spoken one, moved with the tissue, where flow knows how it moved."""
        for done, i in enumerate(frames.clip.train_frames):
            progress(0.8 + 0.2 * done / len(frames.clip.train_frames), "carrying labels along with the tissue")
            if i in spoken:
                continue
            source = min(spoken, key=lambda s: abs(s - i))
            moved, known = evidence.carried(spoken[source][1], source, i)
            moved = np.where(known & frames.valid(i), moved, -1)
            if (moved >= 0).any():
                self._targets[i] = self._target(frames, i, spoken[source][0], moved)

    @staticmethod
    def _reduced(frames: TrainingFrames, i: int, index: np.ndarray) -> np.ndarray:
        """An index map at the working size, int32, −1 where the frame is not valid."""
        small = cv2.resize(index.astype(np.float32), frames.size, interpolation=cv2.INTER_NEAREST).astype(np.int32)
        return np.where(frames.valid(i), small, -1).astype(np.int32)

    def _superpixels(self, frames: TrainingFrames, i: int) -> np.ndarray:
        if i not in self._regions:
            self._regions[i] = superpixels(frames.image(i))
        return self._regions[i]

    def _target(self, frames: TrainingFrames, i: int, vectors: np.ndarray, index: np.ndarray) -> Target:
        flat = index.astype(np.int64).ravel()
        pixels = np.flatnonzero(flat >= 0)
        chosen = flat[pixels]
        weight = 1 / np.sqrt(np.maximum(_said(vectors, np.bincount(chosen, minlength=len(vectors))), 1))[chosen]
        weight /= max(weight.mean(), 1e-12) if len(weight) else 1
        regions = self._superpixels(frames, i).astype(np.int64)
        device = frames.device
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
        target = self._targets[frame]
        flat = latent.reshape(-1, latent.shape[-1])
        predicted, wanted = flat[target.pixels], target.latents[target.index]
        error = angular(predicted, wanted) if use_angles else (predicted - wanted).abs().sum(-1)
        loss = (error * target.weight).sum() / max(len(target.pixels), 1)
        if region_weight > 0:
            loss = loss + region_weight * region_smoothness(flat, target.regions, target.region_count)
        return loss


def _basis(spoken: Spoken, anchors: np.ndarray | None, max_rank: int) -> Basis:
    """The basis of all vectors, weighted by how many pixels have them."""
    vectors = np.concatenate([vectors for vectors, _ in spoken.values()])
    counts = np.concatenate([np.bincount(index[index >= 0], minlength=len(vectors)) for vectors, index in spoken.values()])
    some = slice(None, None, -(-len(vectors) // BASIS_VECTORS))
    return fit_basis(vectors[some], counts[some].astype(np.float64), max_rank=max_rank, anchors=anchors)


def _said(vectors: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """How many pixels say about the same as each vector, float64 [k]: Σ_j counts_j · max(cos_ij, 0)^`LIKE`."""
    unit = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return np.maximum(unit @ unit.T, 0) ** LIKE @ counts.astype(np.float64)
