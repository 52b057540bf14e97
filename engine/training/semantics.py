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
from engine.training.frames import TrainingFrames
from engine.training.losses import angular, region_smoothness


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
        Frames the teacher speaks about.
    """

    def __init__(self, teacher: Teacher, frames: TrainingFrames, progress: Progress = silent):
        spoken: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        clip = frames.clip
        candidates = sorted(set(clip.train_frames) | set(clip.labelled_frames))
        for done, i in enumerate(candidates):
            progress(0.5 * done / len(candidates), "asking the teacher")
            if (answer := teacher.targets(i)) is not None:
                spoken[i] = answer
        if not spoken:
            raise DegenseError(
                f"{clip.path}: the teacher {teacher.name!r} says nothing about any training frame; train with --teacher none or add label maps"
            )
        vectors, counts = [], []
        for vector, index in spoken.values():
            vectors.append(vector)
            counts.append(np.bincount(index[index >= 0].ravel(), minlength=len(vector)))
        self.basis: Basis = fit_basis(np.concatenate(vectors), np.concatenate(counts).astype(np.float64))
        self.frames = sorted(spoken)
        self._targets: dict[int, Target] = {}
        for done, (i, (vector, index)) in enumerate(spoken.items()):
            progress(0.5 + 0.5 * done / len(spoken), "finding superpixels")
            self._targets[i] = self._target(frames, i, vector, index)

    def _target(self, frames: TrainingFrames, i: int, vectors: np.ndarray, index: np.ndarray) -> Target:
        small = cv2.resize(index.astype(np.float32), frames.size, interpolation=cv2.INTER_NEAREST).astype(np.int64).ravel()
        small[~frames.valid(i).ravel()] = -1
        pixels = np.flatnonzero(small >= 0)
        chosen = small[pixels]
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
