"""`python -m engine.masks.bench`: how long a prompt takes, and what region aggregation does to thin instruments, as tables."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from engine.language.basis import fit_basis
from engine.language.encoder import EmbeddedEncoder
from engine.masks.decoders import DECODERS
from engine.masks.query import MaskQuery
from engine.masks.superpixels import superpixels

CLASSES = (
    "liver",
    "fat",
    "gallbladder",
    "grasper",
    "abdominal wall",
    "connective tissue",
    "L-hook electrocautery",
    "charred tissue",
    "background",
)
REPEATS = 7


def scene(width: int, height: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A picture uint8 [H, W, 3] and its label map uint8 [H, W]: two tissues, an ellipse, and instruments 2 to 5 pixels wide."""
    rng = np.random.default_rng(seed)
    labels = np.zeros((height, width), np.uint8)
    labels[:, width // 2 :] = 1
    cv2.ellipse(labels, (width // 3, int(0.6 * height)), (width // 5, height // 6), 0, 0, 360, 2, -1)
    for (x0, y0), (x1, y1), thickness in (((5, 5), (60, 55), 3), ((95, 10), (40, 90), 5), ((20, 92), (85, 70), 2)):
        ends = (x0 * width // 100, y0 * height // 100), (x1 * width // 100, y1 * height // 100)
        cv2.line(labels, *ends, 3, thickness)
    colours = np.array([[150, 60, 50], [190, 120, 80], [110, 110, 60], [150, 150, 160]], np.float32)
    texture = cv2.GaussianBlur(rng.normal(0, 120, (height, width, 3)).astype(np.float32), (0, 0), 5)
    image = cv2.GaussianBlur(colours[labels] + texture + rng.normal(0, 4, texture.shape).astype(np.float32), (3, 3), 0.7)
    return np.clip(image, 0, 255).astype(np.uint8), labels


def latents(
    labels: np.ndarray, vectors: np.ndarray, blur: float = 1.0, noise: float = 0.1, specks: float = 0.002, seed: int = 0
) -> np.ndarray:
    """What a trained field might render for a label map, float32 [H, W, d]: blurred, noisy, with specks of wrong classes."""
    rng = np.random.default_rng(seed)
    height, width = labels.shape
    spoilt = labels.copy()
    for _ in range(int(specks * labels.size / 4)):
        centre = int(rng.integers(width)), int(rng.integers(height))
        cv2.circle(spoilt, centre, int(rng.integers(0, 2)), int(rng.integers(0, labels.max() + 1)), -1)
    smooth = cv2.GaussianBlur(vectors[spoilt], (0, 0), blur) if blur else vectors[spoilt]
    return (smooth + rng.normal(0, noise, smooth.shape)).astype(np.float32)


def overlap(mask: np.ndarray, truth: np.ndarray) -> float:
    """Intersection over union; 1 for two empty masks."""
    union = np.count_nonzero(mask | truth)
    return np.count_nonzero(mask & truth) / union if union else 1.0


def milliseconds(work: Callable[[], object]) -> float:
    """Median wall time of `work`, after one warm-up."""
    work()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def main() -> None:
    encoder = EmbeddedEncoder(CLASSES)
    vectors = encoder.encode(CLASSES)
    basis = fit_basis(vectors, np.ones(len(vectors)))
    projected = basis.project(vectors)
    # fresh directions near the classes, so that nothing is answered from kept maps
    fresh = iter(
        vectors[np.arange(4096) % len(vectors)] + np.random.default_rng(1).normal(0, 1e-3, (4096, encoder.dimension)).astype(np.float32)
    )

    print(f"times in milliseconds, median of {REPEATS}; {len(CLASSES)} classes, latent rank {basis.rank}")
    print(f"{'size':>9} {'superpixels':>12} {'first query':>12} {'new prompt':>11} {'threshold':>10} {'argmax+rnse':>12} {'label map':>10}")
    for width, height in ((640, 512), (854, 480)):
        rgb, labels = scene(width, height)
        latent = latents(labels, projected)
        query = MaskQuery(rgb, latent, basis)
        thresholds = iter(np.linspace(0.3, 0.7, 64))
        row = (
            milliseconds(lambda rgb=rgb: superpixels(rgb)),
            milliseconds(lambda rgb=rgb, latent=latent: MaskQuery(rgb, latent, basis).mask(vectors[3])),
            milliseconds(lambda query=query: query.mask(next(fresh))),
            milliseconds(lambda query=query, thresholds=thresholds: query.mask(vectors[3], threshold=next(thresholds))),
            milliseconds(lambda query=query: query.mask(vectors[3], "rnse+argmax", negatives=vectors)),
            milliseconds(lambda rgb=rgb, latent=latent: MaskQuery(rgb, latent, basis).label_map(vectors)),
        )
        print(
            f"{width:>4}x{height:<4} " + " ".join(f"{value:>{size}.1f}" for value, size in zip(row, (12, 12, 11, 10, 12, 10), strict=True))
        )

    print("\nintersection over union on a synthetic scene, 640x512: mean of classes, and instruments 2 to 5 pixels wide")
    print(f"{'latents':>8} " + " ".join(f"{decoder:>16}" for decoder in DECODERS))
    rgb, labels = scene(640, 512)
    for name, blur, noise, specks in (
        ("exact", 0.0, 0.0, 0.0),
        ("specked", 0.0, 0.05, 0.004),
        ("mild", 1.0, 0.1, 0.002),
        ("hard", 1.5, 0.3, 0.004),
    ):
        query = MaskQuery(rgb, latents(labels, projected, blur, noise, specks), basis)
        scores = {d: [overlap(query.mask(vectors[c], d, negatives=vectors), labels == c) for c in range(4)] for d in DECODERS}
        print(f"{name:>8} " + " ".join(f"{np.mean(scores[d]):>8.3f} {scores[d][3]:>7.3f}" for d in DECODERS))


if __name__ == "__main__":
    main()
