"""Features that nobody wants: losses, masks and teachers fed with zero, huge, half-precision and missing vectors."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from degense.engine.data.readers import open_clip
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Table
from degense.engine.research.stress.long_clips import write_pictures
from degense.engine.research.stress.outcome import COLUMNS, StressFinding, non_finite, row, verdict
from degense.engine.semantics import EmbeddedEncoder, TextEncoder
from degense.engine.semantics.basis import Basis
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.masks.similarity import SHORTEST
from degense.engine.semantics.prompts import DECODERS, PromptVectors
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.losses import angular, l1
from degense.engine.training.semantic.targets import SemanticTargets

HEIGHT, WIDTH, RANK, DIMENSION = 48, 64, 6, 32
TOLERANCE, GRADIENT_TOLERANCE = 1e-5, 1e-4


def table(options: BenchOptions, progress: Progress = silent) -> Table:
    """All features."""
    kinds = latent_kinds()
    rows = []
    for i, (name, latent) in enumerate(kinds.items()):
        progress(0.5 * i / len(kinds), name)
        if np.isfinite(latent).all():  # a drawn latent is finite; what a file or a caller hands to the masks need not be
            rows.append(row(f"angular loss: {name}", partial(loss_finding, latent, options.device)))
        rows.append(row(f"masks: {name}", partial(mask_finding, latent)))
    for i, (name, change) in enumerate(teacher_kinds().items()):
        progress(0.6 + 0.05 * i, name)
        folder = options.scratch / "teacher"
        rows.append(row(f"teacher: {name}", partial(teacher_finding, change, folder, options.device), str(folder)))
    return Table(
        "stress-features",
        "Hostile features",
        f"Latents of {HEIGHT} × {WIDTH} pixels and rank {RANK}. Angular loss: largest difference of a pixel's loss, and of its "
        "gradient times the vector's length, from the same formula in float64 (ε = 1e-4). Masks: largest difference of the cosine "
        "with a prompt from float64, NaN and infinite pixels counting as 0; all decoders run on a constant picture, and refined maps "
        "are counted too. Teacher: supervision of a small clip by vectors of that kind, its loss and gradient. Allowed: "
        f"{TOLERANCE} and {GRADIENT_TOLERANCE}.",
        [column for column in COLUMNS if column.key != "memory"],
        rows,
    )


def latent_kinds() -> dict[str, np.ndarray]:
    """Latent maps [H, W, d] by name."""
    sound = np.random.default_rng(0).normal(size=(HEIGHT, WIDTH, RANK)).astype(np.float32)
    part = np.random.default_rng(1).random((HEIGHT, WIDTH, 1)) < 0.1
    powers = np.logspace(-12, 12, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH, 1)
    return {
        "sound": sound,
        "zero": sound * 0,
        "a tenth zero": np.where(part, np.float32(0), sound),
        "constant": sound * 0 + np.float32(0.3),
        "lengths of 1e-12 to 1e12": sound * powers,
        "1e-30": sound * np.float32(1e-30),
        "a tenth NaN": np.where(part, np.float32(np.nan), sound),
        "a tenth infinite": np.where(part, np.float32(np.inf), sound),
        "3e38": np.sign(sound) * np.float32(3e38),
        "float16": sound.astype(np.float16),
        "float16, zero": (sound * 0).astype(np.float16),
        "float16, largest": np.sign(sound).astype(np.float16) * np.finfo(np.float16).max,
    }


def loss_finding(latent: np.ndarray, device: str) -> StressFinding:
    """The angular loss and its gradient against a constant target."""
    here = torch.from_numpy(latent.reshape(-1, RANK)).to(device).requires_grad_()
    target = torch.ones(HEIGHT * WIDTH, RANK)
    mine = angular(here, target.to(here))
    mine.sum().backward()
    there = torch.from_numpy(latent.reshape(-1, RANK).astype(np.float64)).requires_grad_()
    true = 1 - (there @ torch.ones(RANK, dtype=torch.float64)) / ((there.square().sum(1) + 1e-8) * (RANK + 1e-8)).sqrt()
    true.sum().backward()
    assert here.grad is not None
    assert there.grad is not None
    # row by row and times the length, for a common norm would see nothing but the shortest vectors, whose gradient is the largest
    distance = (here.grad.cpu().double() - there.grad).norm(dim=1) * (there.detach().square().sum(1) + 1e-8).sqrt()
    coarse = 2e3 if latent.dtype == np.float16 else 1.0  # the steps of float16 are wider
    error, gradient = float((mine.detach().cpu().double() - true.detach()).abs().max()), float(distance.max())
    return StressFinding(
        non_finite([mine, here.grad]),
        verdict(value=(error, coarse * TOLERANCE), gradient=(gradient, coarse * GRADIENT_TOLERANCE)),
        error,
        gradient,
    )


def mask_finding(latent: np.ndarray) -> StressFinding:
    """Similarities and masks of a frame of one colour."""
    basis = Basis(np.eye(DIMENSION, RANK, dtype=np.float32), 1.0)
    vectors = np.random.default_rng(2).normal(size=(3, DIMENSION)).astype(np.float32)
    query = FrameSemantics(np.full((HEIGHT, WIDTH, 3), 99, np.uint8), latent, basis)
    out = [
        query.similarity(vectors[0]),
        query.refined(vectors[0]),
        query.confidence(vectors[0], np.ones((HEIGHT, WIDTH), bool), vectors[1:]),
    ]
    for decoder in DECODERS:
        query.decode(PromptVectors(tuple(vectors), classes=vectors, decoder=decoder))
    wide, prompt = latent.astype(np.float64), vectors[0].astype(np.float64)
    wide[~np.isfinite(wide).all(-1)] = 0
    length = np.linalg.norm(wide, axis=-1)
    labelled = np.abs(wide).max(-1) > SHORTEST
    true = np.where(labelled, wide @ prompt[:RANK] / np.where(labelled, length, 1) / np.linalg.norm(prompt), 0)
    error = float(np.abs(out[0] - true).max())
    return StressFinding(non_finite(out), verdict(value=(error, TOLERANCE)), error)


def teacher_kinds() -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """Changes to a teacher's vectors [k, D] by name."""

    def with_row(value: float) -> Callable[[np.ndarray], np.ndarray]:
        return lambda vectors: np.concatenate([vectors[:1] * 0 + value, vectors[1:]]).astype(np.float32)

    return {
        "sound": lambda vectors: vectors,
        "one vector zero": with_row(0.0),
        "one vector NaN": with_row(np.nan),
        "one vector infinite": with_row(np.inf),
        "length 3e37": lambda vectors: vectors * np.float32(3e37),
        "float16": lambda vectors: vectors.astype(np.float16),
        "all vectors the same": lambda vectors: np.repeat(vectors[:1], len(vectors), 0),
        "all vectors zero": lambda vectors: vectors * 0,
    }


class SpoiltTeacher:
    """Says of every training frame that its left half is one thing and its right half another, in spoilt vectors."""

    name, provenance, pixelwise = "spoilt", "made up", True

    def __init__(self, frames: TrainingFrames, change: Callable[[np.ndarray], np.ndarray]):
        self.encoder: TextEncoder = EmbeddedEncoder()
        self.frames = frames.clip.train_frames
        self._vectors = change(self.encoder.encode(["liver", "gallbladder"]))
        width, height = frames.clip.size
        self._index = np.repeat((np.arange(width) > width // 2).astype(np.int32)[None], height, 0)

    def targets(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        return self._vectors, self._index


def teacher_finding(change: Callable[[np.ndarray], np.ndarray], folder: Path, device: str) -> StressFinding:
    """Targets from such a teacher, and the loss of latents that are zero or random. `folder` is made and taken away again."""
    try:
        write_pictures(folder, 4, WIDTH, HEIGHT)
        frames = TrainingFrames(open_clip(folder), 1 << 20, torch.device(device))
        targets = SemanticTargets(SpoiltTeacher(frames, change), frames)
        out: list[Tensor | np.ndarray] = [targets.basis.matrix]
        width, height = frames.size
        for distance in (angular, l1):
            for length in (0.0, 1.0):
                latent = (torch.randn(height, width, targets.basis.rank, device=device) * length).requires_grad_()
                terms = targets.loss(latent, targets.frames[0], distance, 0.1)
                loss = torch.stack(list(terms.values())).sum()
                loss.backward()
                assert latent.grad is not None
                out += [loss.detach(), latent.grad]
        return StressFinding(non_finite(out))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
