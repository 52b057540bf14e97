"""A teacher's unit vectors: which are of one kind, how rare they are, and the words that they are mixtures of."""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
from jaxtyping import Float, Float32
from torch import Tensor

from degense.engine.semantics.basis import unit_rows

SIMILARITY_POWER = 8  # of the cosine with which vectors count as of one kind
NAMED = 0.5  # cosine to a class's vector from which a label is of that class; of image features without classes, all texts are farther
MOST_WORDS = 32  # clusters of vectors in a clip without classes

Vectors = TypeVar("Vectors", np.ndarray, Tensor)


def alike(some: Vectors, others: Vectors) -> Vectors:
    """How far unit vectors [k, d] and [l, d] are of one kind, [k, l] in [0, 1]: max(cos, 0)^`SIMILARITY_POWER`."""
    return (some @ others.T).clip(0) ** SIMILARITY_POWER


def rarity_weights(vectors: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """1/√ of how many pixels have about the same vector, Σ_j counts_j · `alike`_ij: float64 [k]."""
    unit = unit_rows(vectors)
    return 1 / np.sqrt(np.maximum(alike(unit, unit) @ counts.astype(np.float64), 1))


def unit_vectors(vectors: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A teacher's vectors as float32 of unit length, whatever precision and length they came in; zero and non-finite ones are no labels."""
    vectors = np.asarray(vectors, np.float64)  # squares of float16 and float32 must not overflow
    length = np.linalg.norm(vectors, axis=1)
    sound = np.isfinite(length) & (length > 0)
    unit = np.where(sound[:, None], vectors, 0.0) / np.where(sound, length, 1.0)[:, None]
    return unit.astype(np.float32), np.where((index >= 0) & sound[index], index, -1).astype(np.int32)


def words_of(vectors: Float32[np.ndarray, "n D"], classes: Float[np.ndarray, "k D"] | None) -> Float32[np.ndarray, "m D"]:
    """Unit vectors of which a teacher's vectors are mixtures: those of the classes, or its own mean for a class that it has another vector
    for; in clips without classes, the means of `MOST_WORDS` clusters."""
    if classes is None:
        count, rule = min(MOST_WORDS, len(np.unique(vectors, axis=0))), (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 1e-4)
        cv2.setRNGSeed(0)
        return unit_rows(cv2.kmeans(vectors, count, np.zeros((len(vectors), 1), np.int32), rule, 1, cv2.KMEANS_PP_CENTERS)[2])
    nearest = (vectors @ classes.T).argmax(1)
    own = unit_rows(np.stack([vectors[nearest == k].sum(0) for k in range(len(classes))]))
    strange = (np.linalg.norm(own, axis=1) > 0) & ((own * classes).sum(1) < NAMED)
    return np.where(strange[:, None], own, classes).astype(np.float32)


def shares_of(vectors: Float32[np.ndarray, "n D"], words: Float32[np.ndarray, "m D"]) -> Float32[np.ndarray, "n m"]:
    """Vectors as mixtures of words: least squares, what is below 0 left out, rows of sum 1 (or 0)."""
    parts = np.maximum(vectors @ np.linalg.pinv(words), 0)
    return (parts / np.maximum(parts.sum(1, keepdims=True), 1e-12)).astype(np.float32)
