"""`python -m engine.masks.bench`: how long a prompt takes, and what region aggregation does to thin instruments, as tables."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from engine.language.basis import Basis, fit_basis
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


def timings(width: int, height: int, basis: Basis, vectors: np.ndarray) -> list[float]:
    """Milliseconds for superpixels, a frame's first query, a new prompt, a moved threshold, a prompt with rivals, a first label map."""
    rgb, labels = scene(width, height)
    latent = latents(labels, basis.project(vectors))
    query = MaskQuery(rgb, latent, basis)
    rng = np.random.default_rng(1)

    def new_prompt() -> np.ndarray:
        # a fresh direction near a class, so that nothing is answered from kept maps
        return query.mask(vectors[3] + rng.normal(0, 1e-3, vectors.shape[1]))

    return [
        milliseconds(lambda: superpixels(rgb)),
        milliseconds(lambda: MaskQuery(rgb, latent, basis).mask(vectors[3])),
        milliseconds(new_prompt),
        milliseconds(lambda: query.mask(vectors[3], threshold=rng.uniform(0.3, 0.7))),
        milliseconds(lambda: query.mask(vectors[3], "rnse+argmax", negatives=vectors)),
        milliseconds(lambda: MaskQuery(rgb, latent, basis).label_map(vectors)),
    ]


def scores(blur: float, noise: float, specks: float, basis: Basis, vectors: np.ndarray) -> list[float]:
    """For each decoder: mean overlap of the four classes in the scene, then that of the instruments."""
    rgb, labels = scene(640, 512)
    query = MaskQuery(rgb, latents(labels, basis.project(vectors), blur, noise, specks), basis)
    found = []
    for decoder in DECODERS:
        classes = [overlap(query.mask(vectors[c], decoder, negatives=vectors), labels == c) for c in range(4)]
        found += [float(np.mean(classes)), classes[3]]
    return found


def main() -> None:
    vectors = EmbeddedEncoder(CLASSES).encode(CLASSES)
    basis = fit_basis(vectors, np.ones(len(vectors)))

    print(f"times in milliseconds, median of {REPEATS}; {len(CLASSES)} classes, latent rank {basis.rank}")
    columns = ("superpixels", "first query", "new prompt", "threshold", "with rivals", "label map")
    print(f"{'size':>8} " + " ".join(f"{column:>12}" for column in columns))
    for width, height in ((640, 512), (854, 480)):
        row = timings(width, height, basis, vectors)
        print(f"{f'{width}x{height}':>8} " + " ".join(f"{value:>12.1f}" for value in row))

    print("\nintersection over union on a synthetic scene, 640x512: mean of the classes, and the instruments 2 to 5 pixels wide")
    print(f"{'latents':>8} " + " ".join(f"{decoder:>17}" for decoder in DECODERS))
    for name, blur, noise, specks in (
        ("exact", 0.0, 0.0, 0.0),
        ("specked", 0.0, 0.05, 0.004),
        ("mild", 1.0, 0.1, 0.002),
        ("hard", 1.5, 0.3, 0.004),
    ):
        print(f"{name:>8} " + " ".join(f"{value:>8.3f}" for value in scores(blur, noise, specks, basis, vectors)))


if __name__ == "__main__":
    main()
