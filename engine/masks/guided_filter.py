"""Guided filter with a colour guide (He et al. 2013), which also tells how much the guide explains.

In each window of (2r + 1)² pixels the filtered map is a linear function of the colours, fitted with a ridge ε:

    a = (Σ_I + ε)⁻¹ cov(I, p),  b = p̄ − aᵀ Ī,  R² = aᵀ cov(I, p) / var p        G(i) = āᵀ I(i) + b̄

Bars on a and b are means over the windows that hold a pixel. Windows at the border see it repeated.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit, prange

from engine.threads import KERNEL_LOCK


def box(image: np.ndarray, size: int) -> np.ndarray:
    """Mean of size × size pixels, float32 [H, W] or [H, W, C], the border repeated."""
    return cv2.blur(image, (size, size), borderType=cv2.BORDER_REPLICATE).reshape(image.shape)


class GuidedFilter:
    """A guide and its statistics, computed once.

    Parameters
    ----------
    rgb : uint8 [H, W, 3]
    radius : int
        r, pixels.
    flat : float
        ε: the variance of a colour in [0, 1] that counts as flat.
    level : float
        The variance of a map below which R² is taken against this.
    """

    def __init__(self, rgb: np.ndarray, radius: int, flat: float, level: float):
        self._guide = rgb.astype(np.float32) / np.float32(255)
        self._size, self._level = 2 * radius + 1, np.float32(level)
        with KERNEL_LOCK:
            self._moments = box(_moments(self._guide), self._size)
            _invert(self._moments, np.float32(flat))

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """G and the windows' mean R² of a map float32 [H, W], both float32 [H, W]."""
        with KERNEL_LOCK:
            means = box(_products(self._guide, image), self._size)
            _fit(self._moments, means, self._level)
            return _apply(self._guide, box(means, self._size))


@njit(parallel=True, cache=True)
def _moments(guide):
    out = np.empty((*guide.shape[:2], 9), np.float32)
    for y in prange(guide.shape[0]):
        for x in range(guide.shape[1]):
            r, g, b = guide[y, x, 0], guide[y, x, 1], guide[y, x, 2]
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = r, g, b
            out[y, x, 3], out[y, x, 4], out[y, x, 5] = r * r, r * g, r * b
            out[y, x, 6], out[y, x, 7], out[y, x, 8] = g * g, g * b, b * b
    return out


@njit(parallel=True, cache=True)
def _invert(moments, flat):
    """Second moments, in place, to the inverse of the covariance plus flat."""
    for y in prange(moments.shape[0]):
        for x in range(moments.shape[1]):
            m = moments[y, x]
            rr, rg, rb = m[3] - m[0] * m[0] + flat, m[4] - m[0] * m[1], m[5] - m[0] * m[2]
            gg, gb, bb = m[6] - m[1] * m[1] + flat, m[7] - m[1] * m[2], m[8] - m[2] * m[2] + flat
            c0, c1, c2 = gg * bb - gb * gb, rb * gb - rg * bb, rg * gb - rb * gg
            scale = np.float32(1.0) / (rr * c0 + rg * c1 + rb * c2)
            m[3], m[4], m[5] = c0 * scale, c1 * scale, c2 * scale
            m[6], m[7], m[8] = (rr * bb - rb * rb) * scale, (rb * rg - rr * gb) * scale, (rr * gg - rg * rg) * scale


@njit(parallel=True, cache=True)
def _products(guide, image):
    out = np.empty((*image.shape, 5), np.float32)
    for y in prange(image.shape[0]):
        for x in range(image.shape[1]):
            p = image[y, x]
            for c in range(3):
                out[y, x, c] = guide[y, x, c] * p
            out[y, x, 3], out[y, x, 4] = p, p * p
    return out


@njit(parallel=True, cache=True)
def _fit(moments, means, level):
    """Means of (I p, p, p²), in place, to (a, b, R²)."""
    for y in prange(means.shape[0]):
        for x in range(means.shape[1]):
            m, v = moments[y, x], means[y, x]
            p = v[3]
            c0, c1, c2 = v[0] - m[0] * p, v[1] - m[1] * p, v[2] - m[2] * p
            a0 = m[3] * c0 + m[4] * c1 + m[5] * c2
            a1 = m[4] * c0 + m[6] * c1 + m[7] * c2
            a2 = m[5] * c0 + m[7] * c1 + m[8] * c2
            explained = (a0 * c0 + a1 * c1 + a2 * c2) / max(v[4] - p * p, level)
            v[0], v[1], v[2] = a0, a1, a2
            v[3] = p - a0 * m[0] - a1 * m[1] - a2 * m[2]
            v[4] = min(max(explained, np.float32(0.0)), np.float32(1.0))


@njit(parallel=True, cache=True)
def _apply(guide, fit):
    out, explained = np.empty(fit.shape[:2], np.float32), np.empty(fit.shape[:2], np.float32)
    for y in prange(fit.shape[0]):
        for x in range(fit.shape[1]):
            a = fit[y, x]
            out[y, x] = a[0] * guide[y, x, 0] + a[1] * guide[y, x, 1] + a[2] * guide[y, x, 2] + a[3]
            explained[y, x] = a[4]
    return out, explained
