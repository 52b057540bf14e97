"""Region aggregation in memory: numba and OpenCV. The formulas are in `engine.semantics.masks.rnse`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit, prange

from degense.engine.semantics.masks import rnse
from degense.engine.semantics.masks.guided_filter import GuidedFilter
from degense.engine.semantics.masks.similarity import cosines, normalised
from degense.engine.semantics.masks.superpixels import superpixels
from degense.engine.threads import KERNEL_LOCK

BANDS = 8  # of rows, that sums over regions are shared out in
# Kernels get the constants of `rnse` as arguments: numba's cache would not notice that another file changed.


class FrameStatistics(NamedTuple):
    """What region aggregation needs of a frame."""

    regions: np.ndarray  # int32 [H, W]
    means: np.ndarray  # float32 [K, d]; M_k
    weight: np.ndarray  # float32 [H, W]; w: 1 where the mean of the region counts, 0 where the pixel itself does
    noisiness: np.ndarray  # float32 [H, W]; λ'


class CpuAggregation(rnse.Aggregation[np.ndarray]):
    """See `Aggregation`: of rgb uint8 [H, W, 3] (None without regions), latent float32 [H, W, d] and alpha float32 [H, W] or None."""

    def __init__(self, rgb: np.ndarray | None, latent: np.ndarray, alpha: np.ndarray | None = None):
        super().__init__(None if rgb is None else np.ascontiguousarray(rgb))
        self.unit = normalised(latent, alpha)

    @property
    def regions(self) -> np.ndarray:
        return self._labels

    @cached_property
    def _labels(self) -> np.ndarray:
        return superpixels(self._rgb)

    @cached_property
    def statistics(self) -> FrameStatistics:
        return frame_statistics(self.unit, self._labels)

    @cached_property
    def _plain_means(self) -> np.ndarray:
        """Means of unit latents over regions, float32 [K, d]."""
        with KERNEL_LOCK:
            return plain_means(normalised(self.unit), self._labels)

    @cached_property
    def _filter(self) -> GuidedFilter:
        return GuidedFilter(self._rgb, rnse.FLAT, rnse.LEVEL)

    def similarity(self, vectors: np.ndarray) -> np.ndarray:
        return cosines(self.unit, vectors)

    def coarse(self, vectors: np.ndarray) -> np.ndarray:
        """Blend of region means and pixels, float32 [n, H, W]."""
        regions, means, weight, _ = self.statistics
        pixel, regional = cosines(self.unit, vectors), cosines(means[None], vectors)[:, 0]
        with KERNEL_LOCK:
            _blend(pixel, regions, regional, weight)
        return pixel

    def refined(self, vectors: np.ndarray) -> np.ndarray:
        maps = self.coarse(vectors)
        guided, explained = self._filter(maps)
        with KERNEL_LOCK:
            _guide(maps, guided, explained, self.statistics.noisiness, rnse.EXPLAINED, rnse.LEAST_GUIDED)
        return maps

    def means(self, vectors: np.ndarray) -> np.ndarray:
        regional = cosines(self._plain_means[None], vectors)[:, 0]
        return self._filter(np.take(regional, self._labels, axis=1))[0]

    def largest(self, maps: Sequence[np.ndarray]) -> np.ndarray:
        greatest = maps[0]
        for others in maps[1:]:
            greatest = np.maximum(greatest, others, out=None if greatest is maps[0] else greatest)
        return greatest

    def numpy(self, maps: Sequence[np.ndarray]) -> list[np.ndarray]:
        for values in maps:
            values.flags.writeable = False
        return list(maps)


def box(image: np.ndarray, size: int) -> np.ndarray:
    """Mean of size × size pixels, float32 [H, W] or [H, W, C], the border repeated."""
    return cv2.blur(image, (size, size), borderType=cv2.BORDER_REPLICATE).reshape(image.shape)


def frame_statistics(unit: np.ndarray, regions: np.ndarray) -> FrameStatistics:
    """Statistics of normalised latents float32 [H, W, d] in regions int32 [H, W], 0 … K − 1."""
    count = int(regions.max()) + 1
    with KERNEL_LOCK:
        means = _means(unit, regions, plain_means(unit, regions), rnse.MAJORITY)
        rough = _roughness(unit, rnse.STRIDE, rnse.QUIET)
        noise = np.exp(np.bincount(regions.ravel(), rough.ravel(), count) / np.bincount(regions.ravel(), minlength=count))
        low, high = rnse.NOISE
        noisiness = box(np.clip((noise - low) / (high - low), 0, 1).astype(np.float32)[regions], rnse.NOISE_WINDOW)
        direction, agreement = _agreement(unit, box(unit, 3), noisiness, regions, means, rnse.AGREEMENT)
        specks = _specks(direction, agreement, rnse.REACH, rnse.ALIKE)
        noisiness = np.maximum(noisiness, np.minimum(1.0, rnse.SPECK_GAIN * box(specks, rnse.SPECK_WINDOW)))
    return FrameStatistics(regions, means, noisiness * agreement + specks, noisiness)


def plain_means(unit: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """Means of latents float32 [H, W, d] over regions int32 [H, W], 0 … K − 1: float32 [K, d]. The caller holds the lock of kernels."""
    return _means(unit, regions, np.zeros((int(regions.max()) + 1, unit.shape[2]), np.float32), rnse.MAJORITY)


@njit(inline="always")
def _ramp(value, ends):
    return min(max((value - np.float32(ends[0])) / np.float32(ends[1] - ends[0]), np.float32(0.0)), np.float32(1.0))


@njit(inline="always")
def _cosine(a, b):
    product, first, second = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for c in range(a.shape[0]):
        product += a[c] * b[c]
        first += a[c] * a[c]
        second += b[c] * b[c]
    length = np.sqrt(first * second)
    return product / length if length > np.float32(1e-12) else np.float32(0.0)


@njit(parallel=True, cache=True, fastmath=True)
def _means(unit, regions, plain, majority):
    """Means over regions, float32 [K, d], of the pixels that are like `plain` [K, d]; of all where that is zero."""
    height, width, channels = unit.shape
    count = plain.shape[0]
    sums = np.zeros((BANDS, count, channels + 1), np.float64)
    for band in prange(BANDS):
        for y in range(band * height // BANDS, (band + 1) * height // BANDS):
            for x in range(width):
                k = regions[y, x]
                # no pixel is left out altogether: a region of scattered directions has a mean too
                weight = _ramp(_cosine(unit[y, x], plain[k]), majority) + np.float32(1e-3)
                for c in range(channels):
                    sums[band, k, c] += weight * unit[y, x, c]
                sums[band, k, channels] += weight
    out = np.empty((count, channels), np.float32)
    for k in prange(count):
        total = 0.0
        for band in range(BANDS):
            total += sums[band, k, channels]
        for c in range(channels):
            value = 0.0
            for band in range(BANDS):
                value += sums[band, k, c]
            out[k, c] = value / total
    return out


@njit(parallel=True, cache=True, fastmath=True)
def _roughness(unit, step, quiet):
    """log of the least second difference over four directions, float32 [H, W]."""
    height, width, channels = unit.shape
    out = np.empty((height, width), np.float32)
    for y in prange(height):
        up, down = max(y - step, 0), min(y + step, height - 1)
        for x in range(width):
            left, right = max(x - step, 0), min(x + step, width - 1)
            s0, s1, s2, s3 = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for c in range(channels):
                twice = np.float32(2.0) * unit[y, x, c]
                d0 = unit[y, left, c] + unit[y, right, c] - twice
                d1 = unit[up, x, c] + unit[down, x, c] - twice
                d2 = unit[up, left, c] + unit[down, right, c] - twice
                d3 = unit[up, right, c] + unit[down, left, c] - twice
                s0, s1, s2, s3 = s0 + d0 * d0, s1 + d1 * d1, s2 + d2 * d2, s3 + d3 * d3
            out[y, x] = np.log(np.sqrt(min(s0, s1, s2, s3) / np.float32(6.0)) + np.float32(quiet))
    return out


@njit(parallel=True, cache=True, fastmath=True)
def _agreement(unit, local, noisiness, regions, means, ends):
    """z̃ of unit length, float32 [H, W, d], and a, float32 [H, W]."""
    height, width, channels = unit.shape
    direction, agreement = np.empty_like(unit), np.empty((height, width), np.float32)
    for y in prange(height):
        for x in range(width):
            squares = np.float32(0.0)
            for c in range(channels):
                value = unit[y, x, c] + noisiness[y, x] * (local[y, x, c] - unit[y, x, c])
                direction[y, x, c] = value
                squares += value * value
            agreement[y, x] = _ramp(_cosine(direction[y, x], means[regions[y, x]]), ends)
            scale = np.float32(1.0) / max(np.sqrt(squares), np.float32(1e-6))
            for c in range(channels):
                direction[y, x, c] *= scale
    return direction, agreement


@njit(parallel=True, cache=True, fastmath=True)
def _specks(direction, agreement, reach, alike):
    """(1 − a)(1 − c), float32 [H, W]; continuity is looked for only where a pixel is unlike its region, and no further than needed."""
    height, width, channels = direction.shape
    out = np.zeros((height, width), np.float32)
    for y in prange(height):
        for x in range(width):
            if agreement[y, x] >= np.float32(1.0):
                continue
            found = np.float32(0.0)
            for v in range(max(y - reach, 0), min(y + reach + 1, height)):
                step = 1 if abs(v - y) == reach else 2 * reach
                for u in range(x - reach, x + reach + 1, step):
                    if found < np.float32(1.0) and 0 <= u < width:
                        cosine = np.float32(0.0)
                        for c in range(channels):
                            cosine += direction[y, x, c] * direction[v, u, c]
                        found += _ramp(cosine, alike)
            out[y, x] = (np.float32(1.0) - agreement[y, x]) * (np.float32(1.0) - min(found, np.float32(1.0)))
    return out


@njit(parallel=True, cache=True)
def _blend(pixel, regions, means, weight):
    """Pixelwise maps [n, H, W], in place, to coarse ones."""
    for y in prange(pixel.shape[1]):
        for i in range(pixel.shape[0]):
            for x in range(pixel.shape[2]):
                pixel[i, y, x] += weight[y, x] * (means[i, regions[y, x]] - pixel[i, y, x])


@njit(parallel=True, cache=True)
def _guide(coarse, guided, explained, noisiness, ends, least):
    """Coarse maps [n, H, W], in place, to the final ones."""
    for y in prange(coarse.shape[1]):
        for i in range(coarse.shape[0]):
            for x in range(coarse.shape[2]):
                weight = max(np.float32(least), noisiness[y, x], _ramp(explained[i, y, x], ends))
                coarse[i, y, x] += weight * (guided[i, y, x] - coarse[i, y, x])
