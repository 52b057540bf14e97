"""Pixelwise cosine similarity between rendered latents and text vectors, finite for every input."""

from __future__ import annotations

import numpy as np
from numba import njit

from degense.engine.threads import run_kernel, take_ticket

#: Latents shorter than this have no direction but rounding.
SHORTEST = 1e-6
LINES = 32  # that a thread takes at once


def normalised(latent: np.ndarray, alpha: np.ndarray | None = None) -> np.ndarray:
    """z / (‖z‖ + ε), float32 [H, W, d], times alpha where it is given.

    Zero vectors stay zero, and pixels that hold a NaN or an infinity become zero, so every similarity is finite.
    Weighting with alpha, the accumulated opacity float32 [H, W] (clipped to [0, 1]; NaN counts as 0), lowers the similarity of pixels that
    Gaussians barely cover.
    """
    latent = np.asarray(latent, np.float32)
    weight = np.ones(latent.shape[:2], np.float32) if alpha is None else np.asarray(alpha, np.float32)
    out = np.empty(latent.shape, np.float32)
    run_kernel(_normalise, latent, weight, out)
    return out


def cosines(unit: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """⟨ẑ, q⟩, float32 [n, H, W], of normalised latents [H, W, d] with rows q = Bᵀv / ‖v‖ [n, d].

    Each map is the same to the last bit whatever other rows there are, which no matrix product of a library guarantees.
    """
    out = np.empty((len(vectors), *unit.shape[:2]), np.float32)
    run_kernel(_project, np.ascontiguousarray(unit, np.float32), np.ascontiguousarray(vectors, np.float32), out)
    return out


@njit(nogil=True, cache=True)
def _project(unit, vectors, out, counter):
    height, width, channels = unit.shape
    planes = np.empty((channels, width), np.float32)
    while True:
        first = take_ticket(counter) * LINES
        if first >= height:
            return
        for y in range(first, min(first + LINES, height)):
            for x in range(width):
                for c in range(channels):
                    planes[c, x] = unit[y, x, c]
            for i in range(vectors.shape[0]):
                row = out[i, y]
                row[:] = np.float32(0.0)
                for c in range(channels):
                    weight = vectors[i, c]
                    for x in range(width):
                        row[x] += weight * planes[c, x]


@njit(nogil=True, cache=True, error_model="numpy")
def _normalise(latent, alpha, out, counter):
    height, width, channels = latent.shape
    while True:
        first = take_ticket(counter) * LINES
        if first >= height:
            return
        for y in range(first, min(first + LINES, height)):
            for x in range(width):
                largest = np.float32(0.0)
                sound = True
                for c in range(channels):
                    size = abs(latent[y, x, c])
                    sound = sound and size < np.float32(np.inf)  # False for NaN too
                    largest = max(largest, size)
                weight = min(alpha[y, x], np.float32(1.0)) if alpha[y, x] > np.float32(0.0) else np.float32(0.0)  # 0 for NaN too
                if not sound or largest <= np.float32(SHORTEST) or weight == np.float32(0.0):
                    out[y, x] = np.float32(0.0)
                    continue
                # divided by the largest entry first: squares of float32 must not overflow
                shrink, squares = np.float32(1.0) / largest, np.float32(0.0)
                for c in range(channels):
                    part = latent[y, x, c] * shrink
                    out[y, x, c] = part
                    squares += part * part
                scale = weight / np.sqrt(squares)
                for c in range(channels):
                    out[y, x, c] *= scale
