"""Semantics by clusters of Gaussians: instance features learned from segments, a codebook of two levels, one latent each cluster.

The way of OpenGaussian (Wu et al., NeurIPS 2024), for comparison; `engine.research.systems` says what differs from it. It is the
distillation "clusters".
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.progress import Progress, silent
from degense.engine.semantics.masks.superpixels import superpixels
from degense.engine.training.config import TrainConfig
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.losses import rows_of
from degense.engine.training.semantic.distillation import Report, backprojected_targets
from degense.engine.training.semantic.finished import FinishedGeometry
from degense.engine.training.semantic.targets import SemanticTargets

INSTANCE = 6  # length of an instance feature
CODES = (64, 5)  # coarse clusters, and fine ones in each of them
SEGMENTS = 10  # along the longer side of a frame, where the teacher draws no borders of its own
NEAR = 0.01  # squared distance of two segments' features below which they are not pushed apart any harder
KEPT_FRAMES = 128  # frames whose segments are kept
REPORT_EVERY = 25  # steps


def fit_codebook(
    model: SceneModel,
    targets: SemanticTargets,
    frames: TrainingFrames,
    config: TrainConfig,
    stop: Callable[[], bool] = lambda: False,
    progress: Progress = silent,
    report: Report = lambda *_: None,
) -> bool:
    """Give every Gaussian of a finished geometry the latent of its cluster, in place; False when `stop()` asked to leave."""
    geometry = FinishedGeometry(model, frames)
    features = instance_features(geometry, targets, config, stop, lambda f, text: progress(0.8 * f, text), report)
    if features is None:
        return False
    clusters = two_levels(features.cpu().numpy(), model.canonical["means"].detach().cpu().numpy(), CODES, config.seed)
    of = torch.from_numpy(clusters).to(features.device)
    totals = features.new_zeros(len(model), targets.basis.rank)
    for back in backprojected_targets(geometry, targets, lambda f, text: progress(0.8 + 0.2 * f, text)):
        totals += back.total
    vectors = totals.new_zeros(int(of.max()) + 1, totals.shape[1]).index_add(0, of, totals)
    model.canonical["semantics"].data.copy_(torch.nn.functional.normalize(vectors, dim=1)[of])
    return True


def instance_features(
    geometry: FinishedGeometry,
    targets: SemanticTargets,
    config: TrainConfig,
    stop: Callable[[], bool],
    progress: Progress,
    report: Report = lambda *_: None,
) -> Tensor | None:
    """A unit vector [N, `INSTANCE`] for each Gaussian, alike within segments of the frames and unlike between them; None when stopped."""
    random, model = np.random.default_rng(config.seed), geometry.model
    start = random.normal(0, 1, (len(model), INSTANCE))
    raw = torch.from_numpy(start).float().to(model.bounds.device).requires_grad_()
    optimizer = torch.optim.Adam([raw], lr=config.rate_semantics)
    segments_of = lru_cache(KEPT_FRAMES)(lambda frame: segments(targets, geometry.frames, frame))
    total = raw.new_zeros(())
    for step in range(config.semantic_steps):
        if stop():
            return None
        frame = int(random.choice(targets.frames))
        unit = torch.nn.functional.normalize(raw, dim=1)
        image = geometry.placed(frame).draw(unit)
        optimizer.zero_grad(set_to_none=True)
        loss = separation(image.reshape(-1, INSTANCE), segments_of(frame))
        loss.backward()
        optimizer.step()
        total += loss.detach()
        if step % REPORT_EVERY == 0:
            progress(step / config.semantic_steps, "learning to tell segments apart")
        if (step + 1) % REPORT_EVERY == 0 or step + 1 == config.semantic_steps:
            mean = float(total) / (step % REPORT_EVERY + 1)
            report(step + 1, config.semantic_steps, mean, {"separation": mean})
            total.zero_()
    return torch.nn.functional.normalize(raw.detach(), dim=1)


def segments(targets: SemanticTargets, frames: TrainingFrames, frame: int) -> Tensor:
    """Segment of each pixel, int32 [H × W], −1 for none: the regions of a pixelwise teacher, else large superpixels of the frame."""
    if targets.pixelwise:
        return targets.target(frame).index
    regions = superpixels(frames.image(frame), max(1, max(frames.size) // SEGMENTS))
    return torch.from_numpy(np.where(frames.valid(frame), regions, -1).astype(np.int32).ravel()).to(frames.device)


def separation(features: Tensor, segment: Tensor) -> Tensor:
    """Mean squared distance of pixels to their segment's mean, plus the mean over pairs of segments of 1 / (squared distance + `NEAR`).

    Parameters
    ----------
    features : float [P, c]
    segment : int [P]
        −1 does not count.
    """
    here = segment >= 0
    names, member = segment[here].unique(return_inverse=True)
    inside = features[here]
    counts = torch.bincount(member, minlength=len(names)).to(inside.dtype)
    means = inside.new_zeros(len(names), inside.shape[1]).index_add(0, member, inside) / counts[:, None]
    together = (inside - rows_of(means, member)).square().sum(1).mean()
    if len(names) < 2:
        return together
    apart = (means[:, None] - means[None]).square().sum(-1)
    other = ~torch.eye(len(names), dtype=torch.bool, device=apart.device)
    return together + NEAR * (1 / (apart[other] + NEAR)).mean()


def two_levels(features: np.ndarray, places: np.ndarray, codes: tuple[int, int], seed: int) -> np.ndarray:
    """Cluster of each Gaussian, int64 [N], 0 … K − 1 without gaps: first by feature and place, then each cluster by feature alone.

    Parameters
    ----------
    features : float [N, c]
    places : float [N, 3]
        Scaled to the spread of the features, so that near parts of a thing stay together.
    codes : (int, int)
        Clusters of the first level, and most clusters that one of them is divided into.
    """
    spread = np.maximum(places.std(0), 1e-9)
    scaled = (places - places.mean(0)) / spread * features.std(0).mean()
    coarse = _k_means(np.concatenate([features, scaled], 1), codes[0], seed)
    found = np.zeros(len(features), np.int64)
    for code in np.unique(coarse):
        rows = coarse == code
        found[rows] = code * codes[1] + _k_means(features[rows], codes[1], seed)
    return np.unique(found, return_inverse=True)[1].reshape(-1)


def _k_means(points: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Cluster of each point [n, c], int64 [n]; no more clusters than points."""
    if len(points) <= count:
        return np.arange(len(points))
    cv2.setRNGSeed(seed)
    rule = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    start = np.zeros((len(points), 1), np.int32)
    _, labels, _ = cv2.kmeans(np.ascontiguousarray(points, np.float32), count, start, rule, 1, cv2.KMEANS_PP_CENTERS)
    return labels[:, 0].astype(np.int64)
