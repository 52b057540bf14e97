"""A small picture with thin instruments, its latents, and how masks are compared."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.prompts import DEFAULT_DECODER, DEFAULT_THRESHOLD, PromptVectors


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


def mask_of(
    query: FrameSemantics,
    covered: np.ndarray,
    decoder: str = DEFAULT_DECODER,
    threshold: float = DEFAULT_THRESHOLD,
    classes: np.ndarray | None = None,
    excluded: np.ndarray | None = None,
) -> np.ndarray:
    """The mask of one prompt, bool [H, W]."""
    excluding = () if excluded is None else (excluded,)
    return query.decode(PromptVectors((covered,), excluding, classes, decoder, threshold)).masks[0]


def labels_of(query: FrameSemantics, vectors: np.ndarray, decoder: str = DEFAULT_DECODER) -> np.ndarray:
    """The owners of pixels when all classes are prompts, uint8 [H, W]."""
    return query.decode(PromptVectors(tuple(vectors), (), vectors, decoder)).labels


def overlap(mask: np.ndarray, truth: np.ndarray) -> float:
    """Intersection over union; 1 for two empty masks."""
    union = np.count_nonzero(mask | truth)
    return np.count_nonzero(mask & truth) / union if union else 1.0
