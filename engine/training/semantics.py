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
from engine.training.losses import angular, region_smoothness

SPARSE = 0.25  # a teacher that speaks about a smaller share of the training frames has its words carried to the others


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
        Rare vectors weigh more, with the square root of their rarity, so that thin instruments are not drowned by tissue. Mean 1.
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

    Attributes
    ----------
    basis : Basis
    frames : list of int
        Frames that have a target.
    spoken : list of int
        Those the teacher itself speaks about; the others got its words along the optical flow.
    """

    def __init__(self, teacher: Teacher, frames: TrainingFrames, evidence: MotionEvidence | None = None, progress: Progress = silent):
        spoken: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        clip = frames.clip
        candidates = sorted(set(clip.train_frames) | set(clip.labelled_frames))
        for done, i in enumerate(candidates):
            progress(0.5 * done / len(candidates), "asking the teacher")
            if (answer := teacher.targets(i)) is not None and (answer[1] >= 0).any():
                spoken[i] = answer
        if not spoken:
            raise DegenseError(
                f"{clip.path}: the teacher {teacher.name!r} says nothing about any training frame; "
                "train with --teacher none or add label maps"
            )
        vectors, counts = [], []
        for vector, index in spoken.values():
            vectors.append(vector)
            counts.append(np.bincount(index[index >= 0].ravel(), minlength=len(vector)))
        self.basis: Basis = fit_basis(np.concatenate(vectors), np.concatenate(counts).astype(np.float64))
        self._targets: dict[int, Target] = {}
        for done, (i, (vector, index)) in enumerate(spoken.items()):
            progress(0.5 + 0.3 * done / len(spoken), "finding superpixels")
            self._targets[i] = self._target(frames, i, vector, self._reduced(frames, i, index))
        if evidence is not None and len(spoken) < SPARSE * len(clip.train_frames):
            self._carry(spoken, frames, evidence, progress)
        self.frames = sorted(self._targets)
        self.spoken = sorted(spoken)

    def _carry(
        self, spoken: dict[int, tuple[np.ndarray, np.ndarray]], frames: TrainingFrames, evidence: MotionEvidence, progress: Progress
    ) -> None:
        """Give every silent training frame the words of the nearest spoken one, moved with the tissue, where flow knows how it moved."""
        reduced = {i: self._reduced(frames, i, index) for i, (_, index) in spoken.items()}
        for done, i in enumerate(frames.clip.train_frames):
            progress(0.8 + 0.2 * done / len(frames.clip.train_frames), "carrying labels along with the tissue")
            if i in spoken:
                continue
            source = min(spoken, key=lambda s: abs(s - i))
            moved, known = evidence.carried(reduced[source], source, i)
            moved = np.where(known & frames.valid(i), moved, -1)
            if (moved >= 0).any():
                self._targets[i] = self._target(frames, i, spoken[source][0], moved)

    @staticmethod
    def _reduced(frames: TrainingFrames, i: int, index: np.ndarray) -> np.ndarray:
        """An index map at the working size, int32, −1 where the frame is not valid."""
        small = cv2.resize(index.astype(np.float32), frames.size, interpolation=cv2.INTER_NEAREST).astype(np.int32)
        return np.where(frames.valid(i), small, -1).astype(np.int32)

    def _target(self, frames: TrainingFrames, i: int, vectors: np.ndarray, index: np.ndarray) -> Target:
        flat = index.astype(np.int64).ravel()
        pixels = np.flatnonzero(flat >= 0)
        chosen = flat[pixels]
        counts = np.bincount(chosen, minlength=len(vectors)).astype(np.float64)
        weight = 1 / np.sqrt(np.maximum(counts[chosen], 1))
        weight /= max(weight.mean(), 1e-12) if len(weight) else 1
        regions = superpixels(frames.image(i)).astype(np.int64)
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
