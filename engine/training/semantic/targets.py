"""Semantic supervision: what a teacher says of each training frame, in the latent space of a basis."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent
from degense.engine.semantics import Basis, fit_basis
from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.masks.superpixels import superpixels
from degense.engine.semantics.teachers import Teacher
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.losses import angular, chord, region_smoothness
from degense.engine.training.semantic.guided_upsampling import refined_by_regions
from degense.engine.training.semantic.patches import Patches

SPARSE = 0.25  # a teacher that speaks about a smaller share of the training frames has its words carried to the others
LIKE = 8  # power of the cosine with which vectors count as saying the same
BASIS_VECTORS = 20_000  # of all frames' vectors, that the basis is fitted to
TARGET_BYTES = 3 << 28  # of supervision kept
PIXEL_BYTES = 24  # of one pixel's: its word, its patch, and what a target holds

Words = tuple[np.ndarray, np.ndarray]


Kept = TypeVar("Kept")
Vectors = TypeVar("Vectors", np.ndarray, Tensor)


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
        What is rarely said weighs more, with the square root of its rarity, so that thin instruments are not drowned by tissue. Mean 1.
    regions : int32 [H × W]
    region_count : int
    """

    latents: Tensor
    index: Tensor
    pixels: Tensor
    weight: Tensor
    regions: Tensor
    region_count: int


class PatchTarget(NamedTuple):
    """What a coarse teacher says of one frame, patch by patch.

    Attributes
    ----------
    patches : Patches
    latents : float [k, d]
        Its vectors, projected to the basis.
    weight : float [k]
        As a target's, summed over the pixels of a patch; sum 1.
    """

    patches: Patches
    latents: Tensor
    weight: Tensor


class SemanticTargets:
    """All supervision of a clip. That of a frame is made when it is needed and kept while there is room: a long clip's would not fit.

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
    pixelwise : bool
        As the teacher has it.
    shared : bool
        Whether its vectors are shared out over superpixels.
    trust : dict of int → float [k]
        How far each word of a frame is believed (`consistency`); words of frames that are not in it are believed as they are.
    doubted : bool
        Whether a pixelwise teacher contradicts itself, so that mistaken words must not pull harder than others.
    """

    def __init__(
        self,
        teacher: Teacher,
        frames: TrainingFrames,
        evidence: FlowSupervision | None = None,
        progress: Progress = silent,
        *,
        guided: bool = True,
        max_rank: int = 32,
    ):
        self.pixelwise = teacher.pixelwise
        self.shared = guided and not teacher.pixelwise
        self.trust: dict[int, Tensor] = {}
        self.doubted = False
        self._teacher, self._working, self._evidence = teacher, frames, evidence
        clip = frames.clip
        width, height = frames.size
        self._capacity = max(2, TARGET_BYTES // (width * height * PIXEL_BYTES))
        self._words: OrderedDict[int, Words] = OrderedDict()
        self._targets: OrderedDict[int, Target] = OrderedDict()
        self._patches: OrderedDict[int, PatchTarget] = OrderedDict()
        self.spoken: list[int] = []
        vectors, counts = [], []
        for done, i in enumerate(teacher.frames):
            progress(0.7 * done / len(teacher.frames), "asking the teacher")
            if (answer := self._asked(i)) is not None:
                self.spoken.append(i)
                vectors.append(answer[0])
                counts.append(np.bincount(answer[1][answer[1] >= 0], minlength=len(answer[0])))
        if not self.spoken:
            raise DegenseError(
                f"{clip.path}: the teacher {teacher.name!r} says nothing about any training frame; "
                "train with --teacher none or add label maps"
            )
        anchors = None if teacher.pixelwise or not clip.classes else teacher.encoder.encode(clip.classes)
        self.basis: Basis = _basis(np.concatenate(vectors), np.concatenate(counts), anchors, max_rank)
        self._source = {i: i for i in self.spoken}
        if evidence is not None and len(self.spoken) < SPARSE * len(clip.train_frames):
            for done, i in enumerate(clip.train_frames):
                progress(0.7 + 0.3 * done / len(clip.train_frames), "carrying labels along with the tissue")
                source = min(self.spoken, key=lambda s: abs(s - i))
                if i not in self._source and (self._said(i, source)[1] >= 0).any():
                    self._source[i] = source
        self.frames = sorted(self._source)

    def _asked(self, frame: int) -> Words | None:
        """What the teacher says of a frame, if anything, shared out if it is to be: unit vectors, and which of them each pixel has."""
        if frame in self._words:
            self._words.move_to_end(frame)
            return self._words[frame]
        words = self._answered(frame)
        if words is None:
            return None
        if self.shared:
            vectors, index = words
            image = self._working.image(frame)
            regions = superpixels(image)
            vectors = refined_by_regions(vectors, index, image, regions)
            words = vectors, np.where((index >= 0) & (np.linalg.norm(vectors, axis=1)[regions] > 0), regions, -1).astype(np.int32)
        return _keep(self._words, frame, words, self._capacity)

    def _answered(self, frame: int) -> Words | None:
        """The teacher's own words: unit vectors, and which of them each pixel has, int32 at the working size.

        −1 where nothing is said or the frame is not valid.
        """
        answer = self._teacher.targets(frame)
        if answer is None:
            return None
        vectors, index = _directed(*answer)
        index = cv2.resize(index.astype(np.float32), self._working.size, interpolation=cv2.INTER_NEAREST).astype(np.int32)
        index = np.where(self._working.valid(frame), index, -1).astype(np.int32)
        return (vectors, index) if (index >= 0).any() else None

    def _said(self, frame: int, source: int) -> Words:
        """The vectors that `source` has, and which of them each pixel of `frame` should have, int32 at the working size, −1 where none.

        Words of another frame are moved with the tissue, where flow knows how it moved.
        """
        answer = self._asked(source)
        assert answer is not None
        vectors, index = answer
        if source != frame:
            assert self._evidence is not None
            moved, known = self._evidence.warped(index, source, frame)
            index = np.where(known & self._working.valid(frame), moved, -1).astype(np.int32)
        return vectors, index

    def target(self, frame: int) -> Target:
        """The supervision of one of `frames`."""
        if frame in self._targets:
            self._targets.move_to_end(frame)
        else:
            _keep(self._targets, frame, self._target(frame, *self._said(frame, self._source[frame])), self._capacity)
        found = self._targets[frame]
        return replace(found, weight=found.weight * self.trust[frame][found.index]) if frame in self.trust else found

    def _target(self, frame: int, vectors: np.ndarray, index: np.ndarray) -> Target:
        flat = index.ravel()
        pixels = np.flatnonzero(flat >= 0).astype(np.int32)
        chosen = flat[pixels]
        weight = _rarity(vectors, np.bincount(chosen, minlength=len(vectors)))[chosen]
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

    def patch_target(self, frame: int) -> PatchTarget:
        """The teacher's own words of one of `spoken`, against which the means over its patches can be held."""
        if frame in self._patches:
            self._patches.move_to_end(frame)
            return self._patches[frame]
        words = self._answered(frame)
        assert words is not None
        vectors, index = words
        size = np.bincount(index[index >= 0], minlength=len(vectors))
        weight = size * _rarity(vectors, size)
        device = self._working.device
        target = PatchTarget(
            Patches.of(index, len(vectors), device),
            torch.from_numpy(self.basis.project(vectors)).float().to(device),
            torch.from_numpy(weight / weight.sum()).float().to(device),
        )
        return _keep(self._patches, frame, target, self._capacity)

    def loss(self, latent: Tensor, frame: int, *, use_angles: bool, region_weight: float) -> dict[str, Tensor]:
        """The terms `align` (Eq. 3, or L1 for the coupled baseline; the `chord` where `doubted`) and `region` (w·L_smooth, where w > 0) on
        a drawn latent map [H, W, d].
        """
        target = self.target(frame)
        flat = latent.reshape(-1, latent.shape[-1])
        drawn, wanted = flat[target.pixels], target.latents[target.index]
        error = (chord if self.doubted else angular)(drawn, wanted) if use_angles else _l1(drawn, wanted)
        return {"align": (error * target.weight).sum() / max(len(target.pixels), 1), **self._smoothness(flat, frame, region_weight)}

    def patch_loss(self, latent: Tensor, frame: int, *, use_angles: bool, region_weight: float) -> dict[str, Tensor]:
        """`loss` with the teacher's patches as they are, each against the mean of what it sees; with angles, their `chord`."""
        patches, wanted, weight = self.patch_target(frame)
        flat = latent.reshape(-1, latent.shape[-1])
        seen = patches.see(flat)
        error = chord(seen, wanted) if use_angles else _l1(seen, wanted)
        return {"align": (error * weight).sum(), **self._smoothness(flat, frame, region_weight)}

    def _smoothness(self, flat: Tensor, frame: int, weight: float) -> dict[str, Tensor]:
        if weight <= 0:
            return {}
        target = self.target(frame)
        return {"region": weight * region_smoothness(flat, target.regions, target.region_count)}


def _l1(predicted: Tensor, wanted: Tensor) -> Tensor:
    """L1 distance of each row of latents."""
    return (predicted - wanted).abs().sum(-1)


def _keep(kept: OrderedDict[int, Kept], frame: int, value: Kept, capacity: int) -> Kept:
    """Store what a frame has; the frame least recently asked for makes room."""
    kept[frame] = value
    if len(kept) > capacity:
        kept.popitem(last=False)
    return value


def _basis(vectors: np.ndarray, counts: np.ndarray, anchors: np.ndarray | None, max_rank: int) -> Basis:
    """The basis of all vectors, weighted by how many pixels have them."""
    some = slice(None, None, -(-len(vectors) // BASIS_VECTORS))
    return fit_basis(vectors[some], counts[some].astype(np.float64), max_rank=max_rank, anchors=anchors)


def alike(some: Vectors, others: Vectors) -> Vectors:
    """How far unit vectors [k, d] and [l, d] say the same, [k, l] in [0, 1]: max(cos, 0)^`LIKE`."""
    return (some @ others.T).clip(0) ** LIKE


def _rarity(vectors: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """1/√ of how many pixels say about the same as each vector, Σ_j counts_j · `alike`_ij: float64 [k]."""
    unit = unit_rows(vectors)
    return 1 / np.sqrt(np.maximum(alike(unit, unit) @ counts.astype(np.float64), 1))


def _directed(vectors: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A teacher's vectors as float32 of unit length, whatever precision and length they came in; zero and non-finite ones say nothing."""
    vectors = np.asarray(vectors, np.float64)  # squares of float16 and float32 must not overflow
    length = np.linalg.norm(vectors, axis=1)
    sound = np.isfinite(length) & (length > 0)
    unit = np.where(sound[:, None], vectors, 0.0) / np.where(sound, length, 1.0)[:, None]
    return unit.astype(np.float32), np.where((index >= 0) & sound[index], index, -1).astype(np.int32)
