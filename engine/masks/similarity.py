"""Pixelwise cosine similarity between rendered latents and text vectors, finite for every input."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from engine.threads import KERNEL_LOCK

#: Latents shorter than this say nothing: their direction is rounding.
SHORTEST = 1e-6


def normalised(latent: np.ndarray, alpha: np.ndarray | None = None) -> np.ndarray:
    """z / (‖z‖ + ε), float32 [H, W, d], times alpha where it is given.

    Zero vectors stay zero, and pixels that hold a NaN or an infinity become zero, so every similarity is finite.
    Weighting with alpha keeps a pixel that is barely covered by Gaussians from answering with full confidence.

    Parameters
    ----------
    latent : float32 [H, W, d]
    alpha : float32 [H, W], optional
        Accumulated opacity, clipped to [0, 1]; NaN counts as 0.
    """
    latent = np.ascontiguousarray(latent, np.float32)
    weight = np.ones(latent.shape[:2], np.float32) if alpha is None else np.clip(np.nan_to_num(alpha), 0.0, 1.0).astype(np.float32)
    out = np.empty_like(latent)
    with KERNEL_LOCK:
        _normalise(latent, weight, out)
    return out


def cosines(unit: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """⟨ẑ, q⟩, float32 [n, H, W], of normalised latents [H, W, d] with rows q = Bᵀv / ‖v‖ [n, d].

    Each map is the same to the last bit whatever else is asked with it, which no matrix product of a library promises.
    """
    out = np.empty((len(vectors), *unit.shape[:2]), np.float32)
    with KERNEL_LOCK:
        _project(np.ascontiguousarray(unit, np.float32), np.ascontiguousarray(vectors, np.float32), out)
    return out


@njit(parallel=True, cache=True)
def _project(unit, vectors, out):
    height, width, channels = unit.shape
    for y in prange(height):
        planes = np.empty((channels, width), np.float32)
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


@njit(parallel=True, cache=True)
def _normalise(latent, weight, out):
    height, width, channels = latent.shape
    for y in prange(height):
        for x in range(width):
            largest = np.float32(0.0)
            sound = True
            for c in range(channels):
                size = abs(latent[y, x, c])
                sound = sound and size < np.float32(np.inf)  # False for NaN too
                largest = max(largest, size)
            # divided by the largest entry first: squares of float32 must not overflow
            scale = np.float32(0.0)
            if sound and largest > np.float32(SHORTEST):
                squares = np.float32(0.0)
                for c in range(channels):
                    part = latent[y, x, c] / largest
                    squares += part * part
                scale = weight[y, x] / np.sqrt(squares)
            for c in range(channels):
                out[y, x, c] = latent[y, x, c] / largest * scale if scale > np.float32(0.0) else np.float32(0.0)
