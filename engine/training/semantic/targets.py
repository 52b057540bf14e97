"""Semantic supervision: a teacher's labels of each training frame, as targets in the latent space of a basis."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import partial
from math import prod

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.errors import DegenseError
from degense.engine.field.cuda_graphs import graphed
from degense.engine.latest import Latest
from degense.engine.progress import Progress, silent
from degense.engine.semantics import Basis, fit_basis
from degense.engine.semantics.masks.superpixels import centre_grid, superpixels
from degense.engine.semantics.teachers import Teacher
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.fused import semantic_cpu
from degense.engine.training.losses import angular, region_smoothness
from degense.engine.training.semantic.guided_upsampling import upsample_to_regions
from degense.engine.training.semantic.vectors import NAMED, rarity_weights, shares_of, unit_vectors
from degense.engine.vocabulary import instruments

SPARSE = 0.25  # a teacher that labels a smaller share of the training frames has its labels warped to the others
BASIS_VECTORS = 20_000  # of all frames' vectors, that the basis is fitted to
TARGET_BYTES = 3 << 28  # of supervision kept
PIXEL_BYTES = 16  # of one pixel's: its label, and what a target holds

#: A teacher's answer for a frame: unit vectors [k, D], and which of them each pixel has, int32 [H, W], −1 for none.
Answer = tuple[np.ndarray, np.ndarray]
SureAnswer = tuple[np.ndarray, np.ndarray, np.ndarray]  # the same, and how sure each pixel's is, float [H, W]
#: Distance of rows of latents [P, d], [P, d] → [P].
Distance = Callable[[Tensor, Tensor], Tensor]


@dataclass
class Target:
    """Supervision of one frame.

    With `rarity`, what is rare weighs more, with the square root of its rarity, so that thin instruments are not drowned by tissue.
    """

    latents: Tensor  # float [k, d]; the vectors the teacher used here, projected to the basis
    index: Tensor  # int32 [H × W]; which of them each pixel has, −1 for none
    weight: Tensor  # float [H × W]; mean 1 where something is said, else 0
    labelled: Tensor  # float []; how many pixels that is, at least 1
    regions: Tensor  # int32 [H × W]

    @property
    def wanted(self) -> Tensor:
        """The vector of each pixel, float [H × W, d]; some vector where nothing is said."""
        return self.latents.index_select(0, self.index.clamp_min(0))


class SemanticTargets:
    """All supervision of a clip. That of a frame is made when it is needed and kept while there is room: a long clip's would not fit.

    The teacher is asked about its own frames only, so held-out frames stay held out. With `guided` the vectors of a coarse teacher are
    upsampled to the superpixels of the frames (`upsample_to_regions`); with `rarity` what is rare weighs more.
    """

    def __init__(
        self,
        teacher: Teacher,
        frames: TrainingFrames,
        progress: Progress = silent,
        *,
        guided: bool = True,
        rarity: bool = True,
        max_rank: int = 32,
    ):
        self.pixelwise = teacher.pixelwise
        self.upsampled = guided and not teacher.pixelwise  # whether the teacher's vectors are upsampled to superpixels
        self.disagreement: float | None = None  # share of the pixels that it calls otherwise than its consensus, once that is known
        self.accuracy = 1.0  # how often it is right in a frame, as its consensus finds; without one it is taken at its word
        #: How often each of its words is right in each pixel of a frame, float [P, K] (`Consensus.rightness`); None without a consensus.
        self.rightness: Callable[[int], Tensor] | None = None
        self._rarity = rarity
        self._others: Callable[[int], SureAnswer] | None = None
        self._teacher, self._working = teacher, frames
        self._flow: FlowSupervision | None = None
        clip = frames.clip
        capacity = max(2, TARGET_BYTES // (frames.size[0] * frames.size[1] * PIXEL_BYTES))
        self._answers, self._targets = Latest(capacity), Latest(capacity)
        self._region_count = prod(centre_grid(*frames.size))
        self._losses: dict[tuple[Distance, float], Callable[..., tuple[Tensor, ...]]] = {}
        self.labelled_frames: list[int] = []  # those that the teacher itself labels
        vectors, counts = [], []
        for done, i in enumerate(teacher.frames):
            progress(done / len(teacher.frames), "asking the teacher")
            if (answer := self.answer(i)) is not None:
                self.labelled_frames.append(i)
                vectors.append(answer[0])
                counts.append(np.bincount(answer[1][answer[1] >= 0], minlength=len(answer[0])))
        if not self.labelled_frames:
            raise DegenseError(
                f"{clip.path}: the teacher {teacher.name!r} labels no training frame; train with --teacher none or add label maps"
            )
        self.classes = teacher.encoder.encode(clip.classes) if clip.classes else None
        every = slice(None, None, -(-sum(map(len, vectors)) // BASIS_VECTORS))
        sizes = np.concatenate(counts)[every].astype(np.float64)
        #: Vectors of all its frames, float32 [n, D].
        self.sample = np.concatenate(vectors)[every]
        named = teacher.pixelwise and (self.classes is None or float((self.sample @ self.classes.T).max(1).min()) > NAMED)
        anchors = None if named else self.classes  # of classes that are not among the vectors, as texts of a CLIP, the basis keeps all
        self.basis: Basis = fit_basis(self.sample, sizes, max_rank=max_rank, anchors=anchors)
        self._source = {i: i for i in self.labelled_frames}
        self.frames = sorted(self._source)  # those that have a target; `propagate` adds others

    def propagate(self, flow: FlowSupervision, progress: Progress = silent) -> None:
        """Warp the labels of a teacher that labels few training frames to the others, along the optical flow."""
        train = self._working.clip.train_frames
        if not self.sparse:
            return
        self._flow = flow
        for done, i in enumerate(train):
            progress(done / len(train), "warping labels along with the tissue")
            source = min(self.labelled_frames, key=lambda s: abs(s - i))
            if i not in self._source and (self._labels(i, source)[1] >= 0).any():
                self._source[i] = source
        self.frames = sorted(self._source)

    def tools(self, frame: int) -> np.ndarray | None:
        """Pixels that the teacher calls an instrument, bool [H, W] at the working size: of all classes' vectors that of an instrument is
        nearest to theirs, with a cosine above `NAMED`.

        None where the teacher does not say: on frames that it does not label, and in clips that name no instruments. Patches of a coarse
        teacher say it of no pixel: they take tissue beside an instrument, and what looks like one, for it.
        """
        tools = instruments(self._working.clip.classes)
        answer = self.answer(frame) if tools and self.pixelwise and frame in self.labelled_frames else None
        if answer is None or self.classes is None:
            return None
        vectors, index = answer
        alike = vectors @ self.classes.T
        tool = np.isin(alike.argmax(1), tools) & (alike.max(1) > NAMED)
        return (index >= 0) & tool[index]

    @property
    def sparse(self) -> bool:
        """Whether the teacher labels too few of the training frames to be compared with itself."""
        return len(self.labelled_frames) < SPARSE * len(self._working.clip.train_frames)

    def replaced(self, answers: Callable[[int], SureAnswer]) -> SemanticTargets:
        """Targets with other answers on the teacher's frames than its own, weighted by how sure they are."""
        changed = copy(self)
        changed._others, changed._targets = answers, Latest(self._targets.limit)
        return changed

    def answer(self, frame: int) -> Answer | None:
        """The teacher's answer for a frame, if it has one, upsampled if it is to be."""
        make = self._upsampled_answer if self.upsampled else self._teacher_answer
        return self._answers.get(frame, lambda: make(frame))

    def told(self, frame: int, words: np.ndarray) -> np.ndarray:
        """Which of the words [m, D] the teacher has for each pixel of a frame that it labels, int [H, W]; −1 where it says nothing."""
        answer = self.answer(frame)
        assert answer is not None
        vectors, index = answer
        return np.where(index >= 0, shares_of(vectors, words).argmax(1)[index], -1)

    def _upsampled_answer(self, frame: int) -> Answer | None:
        answer = self._teacher_answer(frame)
        if answer is None:
            return None
        vectors, index = answer
        image = self._working.image(frame)
        regions = superpixels(image)
        vectors = upsample_to_regions(vectors, index, image, regions)
        return vectors, np.where((index >= 0) & (np.linalg.norm(vectors, axis=1)[regions] > 0), regions, -1).astype(np.int32)

    def _teacher_answer(self, frame: int) -> Answer | None:
        """The teacher's own answer at the working size; −1 also where the frame is not valid."""
        answer = self._teacher.targets(frame)
        if answer is None:
            return None
        vectors, index = unit_vectors(*answer)
        index = cv2.resize(index.astype(np.float32), self._working.size, interpolation=cv2.INTER_NEAREST).astype(np.int32)
        index = np.where(self._working.valid(frame), index, -1).astype(np.int32)
        return (vectors, index) if (index >= 0).any() else None

    def _labels(self, frame: int, source: int) -> Answer:
        """The answer for `source`, warped to `frame` with the tissue, where flow knows how it moved."""
        answer = self.answer(source)
        assert answer is not None
        vectors, index = answer
        if source != frame:
            assert self._flow is not None
            moved, known = self._flow.warped(index, source, frame)
            index = np.where(known & self._working.valid(frame), moved, -1).astype(np.int32)
        return vectors, index

    def target(self, frame: int) -> Target:
        """The supervision of one of `frames`."""
        return self._targets.get(frame, lambda: self._target(frame))

    def _target(self, frame: int) -> Target:
        if self._others is None:
            vectors, index = self._labels(frame, self._source[frame])
        else:
            vectors, index, confidence = self._others(frame)
        index, known = index.ravel(), index.ravel() >= 0
        counts = np.bincount(index[known], minlength=len(vectors))
        weight = np.where(known, (rarity_weights(vectors, counts) if self._rarity else np.ones(len(vectors)))[index], 0.0)
        labelled = max(np.count_nonzero(known), 1)
        weight *= labelled / max(weight.sum(), 1e-12)
        if self._others is not None:
            weight = weight * confidence.ravel()
        latents, of_pixel = self.basis.project(vectors).astype(np.float32), superpixels(self._working.image(frame)).ravel()
        parts = (latents, index.astype(np.int32), weight.astype(np.float32), np.array(labelled, np.float32), of_pixel)
        return Target(*(torch.from_numpy(part).to(self._working.device) for part in parts))

    def loss(self, latent: Tensor, frame: int, distance: Distance, region_weight: float) -> dict[str, Tensor]:
        """Terms of the loss of a drawn latent map [H, W, d].

        `align`: mean distance (`angular`, Eq. 3, or `l1`) to the frame's target; `region`: w·L_smooth, where w > 0.
        """
        target = self.target(frame)
        flat = latent.reshape(-1, latent.shape[-1])
        if distance is angular and flat.device.type == "cpu" and flat.dtype == torch.float32:
            labels = semantic_cpu.Labels(target.latents, target.index, target.weight, target.labelled)
            found = {"align": semantic_cpu.align(flat, labels)}
            if region_weight > 0:
                found["region"] = region_weight * semantic_cpu.region_smoothness(flat, target.regions, self._region_count)
            return found
        arguments = flat, target.wanted, target.weight, target.labelled, target.regions
        key = distance, region_weight
        if key not in self._losses:
            terms = partial(_terms, distance=distance, region_weight=region_weight, region_count=self._region_count)
            self._losses[key] = graphed(terms, [argument.detach().requires_grad_(argument is flat) for argument in arguments])
        names = ("align", "region") if region_weight > 0 else ("align",)
        return dict(zip(names, self._losses[key](*arguments), strict=True))


def _terms(
    latent: Tensor,
    wanted: Tensor,
    weight: Tensor,
    labelled: Tensor,
    regions: Tensor,
    *,
    distance: Distance,
    region_weight: float,
    region_count: int,
) -> tuple[Tensor, ...]:
    """`SemanticTargets.loss` of rows of latents, float [H × W, d]."""
    align = (distance(latent, wanted) * weight).sum() / labelled
    return (align, region_weight * region_smoothness(latent, regions, region_count)) if region_weight > 0 else (align,)
