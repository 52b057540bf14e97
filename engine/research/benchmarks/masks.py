"""Superpixels, decoders and prompts: time against mask quality."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import cv2
import numpy as np
import torch
from skimage.segmentation import slic

from degense.engine.errors import DegenseError
from degense.engine.metrics.masks import boundary_f, iou
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.mask_scenes import DEGRADATIONS, MaskFrame, MaskScene, hand_frame, phantom_frame
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.timing import measure
from degense.engine.semantics.basis import Basis, fit_basis
from degense.engine.semantics.masks import FrameSemantics, superpixels
from degense.engine.semantics.masks.superpixels_torch import superpixels_on_device
from degense.engine.semantics.prompts import DECODERS, PromptVectors
from degense.engine.semantics.text.encoder import EmbeddedEncoder

TOOLS = ("grasper", "L-hook electrocautery")
TIMES = (0.3, 0.45, 0.6)  # of the phantom's story: grasped, burning, burnt
EDGE = 2.0  # pixels: tolerance of boundaries
SMALLEST = 30  # pixels: a class with fewer in a frame does not count in it


def run(options: BenchOptions, progress: Progress = silent) -> Iterable[Table]:
    """Three tables: superpixels, decoders and prompts."""
    progress(0.0, "superpixels")
    yield _superpixels(options)
    progress(0.3, "decoders")
    yield _decoders(options, progress)
    progress(0.8, "prompts")
    yield _prompts(options)


# -- superpixels ---------------------------------------------------------------------------------------------------------------------------
Segment = Callable[[np.ndarray], np.ndarray]


def _segmentations(quick: bool) -> Iterator[tuple[str, Segment]]:
    """Algorithms by name; all return regions int32 [H, W] of an RGB image."""

    def ours(size: int, compactness: float) -> Segment:
        return lambda rgb: superpixels(rgb, size, compactness)

    def opencv(kind: int, size: int) -> Segment:
        def segment(rgb: np.ndarray) -> np.ndarray:
            lab = cv2.cvtColor(cv2.GaussianBlur(rgb, (3, 3), 0), cv2.COLOR_RGB2LAB)
            found = cv2.ximgproc.createSuperpixelLSC(lab, size) if kind < 0 else cv2.ximgproc.createSuperpixelSLIC(lab, kind, size)
            found.iterate(10)
            return found.getLabels()

        return segment

    def scikit(size: int) -> Segment:
        return lambda rgb: slic(rgb, rgb[..., 0].size // size**2, start_label=0)

    if not hasattr(cv2, "ximgproc"):
        raise DegenseError(
            "comparing superpixels needs OpenCV with contrib modules: pip install --force-reinstall opencv-contrib-python-headless"
        )
    for size in (8, 12, 16, 24):
        for compactness in (10.0,) if quick else (5.0, 10.0, 20.0):
            yield f"ours, {size} px, compactness {compactness:g}", ours(size, compactness)
    for size in (12,) if quick else (8, 12, 16):
        yield f"OpenCV SLIC, {size} px", opencv(cv2.ximgproc.SLIC, size)
        yield f"OpenCV SLICO, {size} px", opencv(cv2.ximgproc.SLICO, size)
        yield f"OpenCV LSC, {size} px", opencv(-1, size)
        yield f"scikit-image SLIC, {size} px", scikit(size)


def achievable_accuracy(regions: np.ndarray, labels: np.ndarray) -> float:
    """Share of pixels that are right when every region takes its commonest label."""
    votes = np.zeros((int(regions.max()) + 1, 256))
    np.add.at(votes, (regions.ravel(), labels.ravel()), 1)
    return float(votes.max(1).sum() / labels.size)


def boundary_recall(regions: np.ndarray, labels: np.ndarray) -> float:
    """Share of label boundaries with a region boundary within `EDGE` pixels."""
    found, true = _boundaries(regions), _boundaries(labels)
    distance = cv2.distanceTransform((~found).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return float((distance[true] <= EDGE).mean())


def _boundaries(labels: np.ndarray) -> np.ndarray:
    out = np.zeros(labels.shape, bool)
    out[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    out[1:] |= labels[1:] != labels[:-1]
    return out


def _superpixels(options: BenchOptions) -> Table:
    width, height = _size(options)
    frames = [phantom_frame(width, height, seed, TIMES[1]) for seed in options.seeds]
    table = Table(
        "superpixels",
        "Superpixels: time against how well they can follow the anatomy",
        f"Phantom frames {width} × {height}, one for each seed of {list(options.seeds)}. Accuracy: every region takes its commonest label. "
        f"Boundary recall: within {EDGE:g} pixels. Error is 1 − accuracy. OpenCV's and scikit-image's on the CPU, ten rounds.",
        [
            Column("name", "algorithm"),
            Column("ms", "ms", 1),
            Column("regions", "regions", 0),
            Column("accuracy", "achievable accuracy", 4, "mean"),
            Column("recall", "boundary recall", 3, "mean"),
            Column("error", "error", 4, "mean"),
        ],
        pareto=("ms", "error"),
    )
    for name, segment in _segmentations(options.quick):
        found = [segment(frame.rgb) for frame in frames]
        times = measure(partial(segment, frames[0].rgb), options.repeats, warm=1)
        table.rows.append(_superpixel_row(name, times, found, frames))
    if options.device == "cuda":
        images = [torch.from_numpy(frame.rgb).cuda() for frame in frames]
        found = [superpixels_on_device(image)[0].cpu().numpy() for image in images]
        times = measure(lambda: superpixels_on_device(images[0]), options.repeats, "cuda")
        table.rows.append(_superpixel_row("ours, 12 px, compactness 10, on the GPU", times, found, frames))
    return table


def _superpixel_row(name: str, times: list[float], found: list[np.ndarray], frames: list[MaskFrame]) -> dict[str, Cell]:
    accuracy = [achievable_accuracy(regions, frame.labels) for regions, frame in zip(found, frames, strict=True)]
    return {
        "name": name,
        "ms": times,
        "regions": [float(len(np.unique(regions))) for regions in found],
        "accuracy": accuracy,
        "recall": [boundary_recall(regions, frame.labels) for regions, frame in zip(found, frames, strict=True)],
        "error": [1 - value for value in accuracy],
    }


# -- decoders ------------------------------------------------------------------------------------------------------------------------------
def _decoders(options: BenchOptions, progress: Progress) -> Table:
    width, height = _size(options)
    if not options.quick:
        width, height = 640, 512
    spoilt = "; ".join(f"{name}: {degradation.words}" for name, degradation in DEGRADATIONS.items())
    table = Table(
        "decoders",
        "Decoders: time against mask quality, instruments apart",
        f"Latents of the true label map, spoilt as named ({spoilt}), "
        f"at {width} × {height}, seeds {list(options.seeds)}. Phantom: three moments; hand-made: instruments 1 to 6 pixels wide, with "
        "tips and highlights; pale: the same, a fifth of the contrast. Label maps over all classes; masks of one prompt at threshold 0.5 "
        f"with the other classes as rivals. Means over classes, moments and seeds; boundary F within {EDGE:g} pixels. Time: a label map "
        "of a frame whose similarities are not kept.",
        [
            Column("name", "scene, latents, decoder"),
            Column("ms", "ms", 1),
            Column("tools", "IoU instruments", 3, "mean"),
            Column("tools_f", "boundary F instruments", 3, "mean"),
            Column("tissue", "IoU tissue", 3, "mean"),
            Column("tissue_f", "boundary F tissue", 3, "mean"),
            Column("labels", "IoU instruments, label map", 3, "mean"),
            Column("error", "error (1 − mean IoU)", 4, "mean"),
            Column("classes", "IoU by class"),
        ],
    )
    scenes: list[tuple[str, Callable[[int], list[MaskFrame]]]] = [
        ("phantom", lambda seed: [phantom_frame(width, height, seed, time) for time in TIMES]),
        ("hand-made", lambda seed: [hand_frame(width, height, seed)]),
        ("pale", lambda seed: [hand_frame(width, height, seed, contrast=0.2)]),
    ]
    for i, (scene, make) in enumerate(scenes):
        frames = {seed: make(seed) for seed in options.seeds}
        for j, degradation in enumerate(DEGRADATIONS):
            progress(0.3 + 0.5 * (i + j / len(DEGRADATIONS)) / len(scenes), f"decoders on {scene}, {degradation}")
            for decoder in DECODERS:
                table.rows.append(_decoder_row(scene, degradation, decoder, frames, options))
    return table


def _decoder_row(scene: str, degradation: str, decoder: str, frames: dict[int, list[MaskFrame]], options: BenchOptions) -> dict[str, Cell]:
    scores: dict[str, list[float]] = {key: [] for key in ("tools", "tools_f", "tissue", "tissue_f", "labels", "error")}
    by_class: dict[str, list[float]] = {}
    times: list[float] = []
    for seed, pictures in frames.items():
        values: dict[str, list[float]] = {key: [] for key in scores}
        for frame in pictures:
            vectors = EmbeddedEncoder(frame.classes).encode(frame.classes)
            basis = fit_basis(vectors, np.ones(len(vectors)))
            latent = DEGRADATIONS[degradation].apply(frame.labels, basis.project(vectors), seed)
            rgb, latent = _on(options.device, frame.rgb, latent)
            query = FrameSemantics(rgb, latent, basis)
            found = query.decode(PromptVectors(tuple(vectors), classes=vectors, decoder=decoder))
            for c, name in enumerate(frame.classes):
                truth = frame.labels == c
                if np.count_nonzero(truth) < SMALLEST:
                    continue
                kind = "tools" if name in TOOLS else "tissue"
                score = iou(found.masks[c], truth) or 0.0
                values[kind].append(score)
                values[f"{kind}_f"].append(boundary_f(found.masks[c], truth, EDGE) or 0.0)
                values["error"].append(1 - score)
                by_class.setdefault(name, []).append(score)
                if kind == "tools":
                    values["labels"].append(iou(found.labels == c, truth) or 0.0)
        for key, cell in values.items():
            if cell:
                scores[key].append(float(np.mean(cell)))
        work = partial(_masks, rgb, latent, basis, vectors, decoder)
        times += measure(work, 1, options.device, warm=1)
    words = ", ".join(f"{name} {np.mean(values):.3f}" for name, values in sorted(by_class.items()))
    return {"name": f"{scene}, {degradation}, {decoder}", "ms": times, **scores, "classes": words}


def _masks(rgb: Any, latent: Any, basis: Basis, vectors: np.ndarray, decoder: str) -> np.ndarray:
    return FrameSemantics(rgb, latent, basis).decode(PromptVectors(tuple(vectors), classes=vectors, decoder=decoder)).masks


# -- prompts -------------------------------------------------------------------------------------------------------------------------------
def _prompts(options: BenchOptions) -> Table:
    width, height = _size(options)
    table = Table(
        "prompts",
        "Prompts: from words' vectors to a mask in memory",
        f"{width} × {height}, Gaussians on the pixels of a phantom frame, each with its class; a new frame is drawn anew. "
        f"{options.repeats} repeats after three; every other prompt is a new vector, so that no kept map answers.",
        [Column("name", "what"), Column("ms", "ms, median", 1), Column("p95", "ms, 95th percentile", 1)],
    )
    for gaussians in (30_000,) if options.quick else (30_000, 60_000):
        for name, work in _questions(MaskScene(width, height, gaussians, options.device)):
            times = measure(work, options.repeats, options.device)
            row: dict[str, Cell] = {"name": f"{name}, {gaussians:,} Gaussians", "ms": float(np.median(times))}
            table.rows.append(row | {"p95": float(np.percentile(times, 95))})
    return table


def _questions(scene: MaskScene) -> list[tuple[str, Callable[[], object]]]:
    rng = np.random.default_rng(0)
    vectors, kept = scene.vectors, scene.query()
    sure = vectors[0]

    def fresh(count: int = 1) -> np.ndarray:
        # as near to a class as a synonym: no kept map answers
        return vectors[:count] + rng.normal(0, 1e-3, (count, vectors.shape[1])).astype(np.float32)

    return [
        ("drawing alone", scene.draw),
        ("first prompt on a new frame, drawing included", lambda: scene.query().decode(PromptVectors((sure,)))),
        ("first prompt on a new frame, all classes competing", lambda: scene.query().decode(PromptVectors((sure,), classes=vectors))),
        ("another prompt", lambda: kept.decode(PromptVectors((fresh()[0],)))),
        ("another threshold", lambda: kept.decode(PromptVectors((sure,), threshold=rng.uniform(0.3, 0.7)))),
        (f"{len(vectors)} new prompts at once", lambda: kept.decode(PromptVectors(tuple(fresh(len(vectors)))))),
    ]


def _size(options: BenchOptions) -> tuple[int, int]:
    return (320, 256) if options.quick else (854, 480)


def _on(device: str, rgb: np.ndarray, latent: np.ndarray) -> tuple[Any, Any]:
    return (rgb, latent) if device == "cpu" else (torch.from_numpy(rgb).to(device), torch.from_numpy(latent).to(device))
