"""Guided filter with a colour guide (He et al. 2013), which also tells how much the guide explains.

In each window of (2r + 1)² pixels the filtered map is a linear function of the colours, fitted with a ridge ε:

    a = (Σ_I + ε)⁻¹ cov(I, p),  b = p̄ − aᵀ Ī,  R² = aᵀ cov(I, p) / var p        G(i) = āᵀ I(i) + b̄

Bars on a and b are means over the windows that hold a pixel. Windows at the border see it repeated.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from degense.engine.threads import run_kernel, take_ticket

#: r and the side of a window, pixels. Constants, for the kernels: loops of known length become vector instructions.
RADIUS = 3
SIZE = 2 * RADIUS + 1
BAND = 48  # rows that a thread takes at once; it also works out some rows above and below


class GuidedFilter:
    """A guide uint8 [H, W, 3] and its statistics, computed once.

    `flat` is ε, the variance of a colour in [0, 1] that counts as flat; R² is taken against `level` where a map's variance is below it.
    """

    def __init__(self, rgb: np.ndarray, flat: float, level: float):
        self._guide = np.multiply(rgb.transpose(2, 0, 1), np.float32(1 / 255), order="C")
        self._level = np.float32(level)
        self._moments = np.empty((rgb.shape[0], 9, rgb.shape[1]), np.float32)
        run_kernel(_statistics, self._guide, np.float32(flat), self._moments)

    def __call__(self, maps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """G and the windows' mean R² of maps float32 [n, H, W], both float32 [n, H, W]."""
        guided, explained = np.empty_like(maps), np.empty_like(maps)
        run_kernel(_filter, maps, self._guide, self._moments, self._level, guided, explained)
        return guided, explained


@njit(nogil=True, cache=True, error_model="numpy")
def _statistics(guide, flat, moments, counter):
    """Of every row, mean colours and (Σ + ε)⁻¹ in the order rr, rg, rb, gg, gb, bb, [H, 9, W]."""
    _, height, width = guide.shape
    wide, sums = np.empty(width + 2 * RADIUS, np.float32), np.empty((SIZE, 9, width), np.float32)
    while True:
        first = take_ticket(counter) * BAND
        if first >= height:
            return
        known = max(first - RADIUS, 0)
        for y in range(first, min(first + BAND, height)):
            while known <= min(y + RADIUS, height - 1):
                red, green, blue, row = guide[0, known], guide[1, known], guide[2, known], sums[known % SIZE]
                _across(red, wide, row[0])
                _across(green, wide, row[1])
                _across(blue, wide, row[2])
                for plane, (a, b) in enumerate(((red, red), (red, green), (red, blue), (green, green), (green, blue), (blue, blue))):
                    _across_product(a, b, wide, row[3 + plane])
                known += 1
            m = moments[y]
            for plane in range(9):
                _down(sums, plane, y, height, m[plane])
            for x in range(width):
                r, g, b = m[0, x], m[1, x], m[2, x]
                rr, rg, rb = m[3, x] - r * r + flat, m[4, x] - r * g, m[5, x] - r * b
                gg, gb, bb = m[6, x] - g * g + flat, m[7, x] - g * b, m[8, x] - b * b + flat
                c0, c1, c2 = gg * bb - gb * gb, rb * gb - rg * bb, rg * gb - rb * gg
                scale = np.float32(1.0) / (rr * c0 + rg * c1 + rb * c2)
                m[3, x], m[4, x], m[5, x] = c0 * scale, c1 * scale, c2 * scale
                m[6, x], m[7, x], m[8, x] = (rr * bb - rb * rb) * scale, (rb * rg - rr * gb) * scale, (rr * gg - rg * rg) * scale


@njit(nogil=True, cache=True, error_model="numpy")
def _filter(maps, guide, moments, level, guided, explained, counter):
    """`guided` and `explained` of bands of all maps."""
    count, height, width = maps.shape
    bands = (height + BAND - 1) // BAND
    wide, means = np.empty(width + 2 * RADIUS, np.float32), np.empty((5, width), np.float32)
    sums, fits = np.empty((SIZE, 5, width), np.float32), np.empty((SIZE, 5, width), np.float32)  # of the last rows, summed along them
    while True:
        ticket = take_ticket(counter)
        if ticket >= count * bands:
            return
        i, first = ticket // bands, ticket % bands * BAND
        known, fitted = max(first - 2 * RADIUS, 0), max(first - RADIUS, 0)
        for y in range(first, min(first + BAND, height)):
            while fitted <= min(y + RADIUS, height - 1):
                while known <= min(fitted + RADIUS, height - 1):
                    p, row = maps[i, known], sums[known % SIZE]
                    for plane in range(3):
                        _across_product(p, guide[plane, known], wide, row[plane])
                    _across(p, wide, row[3])
                    _across_product(p, p, wide, row[4])
                    known += 1
                for plane in range(5):
                    _down(sums, plane, fitted, height, means[plane])
                _fit(means, moments[fitted], level, wide, fits[fitted % SIZE])
                fitted += 1
            for plane in range(4):
                _down(fits, plane, y, height, means[plane])
            _down(fits, 4, y, height, explained[i, y])
            _product(means[0], guide[0, y], means[1], guide[1, y], means[2], guide[2, y], guided[i, y])
            _add(guided[i, y], means[3])


@njit(inline="always")
def _fit(means, m, level, wide, out):
    """Means of (I p, p, p²) in the windows of a row to (a, b, R²), summed along the row, [5, W]."""
    p, square = means[3], means[4]
    for channel in range(3):
        for x in range(len(p)):
            means[channel, x] -= m[channel, x] * p[x]  # cov(I, p)
    for x in range(len(p)):
        square[x] = max(square[x] - p[x] * p[x], level)
    a, part = np.empty((3, len(p)), np.float32), np.empty(len(p), np.float32)
    _product(m[3], means[0], m[4], means[1], m[5], means[2], a[0])
    _product(m[4], means[0], m[6], means[1], m[7], means[2], a[1])
    _product(m[5], means[0], m[7], means[1], m[8], means[2], a[2])
    _product(a[0], means[0], a[1], means[1], a[2], means[2], part)
    for x in range(len(p)):
        square[x] = min(max(part[x] / square[x], np.float32(0.0)), np.float32(1.0))
    _product(a[0], m[0], a[1], m[1], a[2], m[2], part)
    for x in range(len(p)):
        p[x] -= part[x]
    for channel in range(3):
        _across(a[channel], wide, out[channel])
    _across(p, wide, out[3])
    _across(square, wide, out[4])


# Loops over a row, each of few arrays: what a compiler turns into vector instructions.
@njit(error_model="numpy")
def _product(a0, b0, a1, b1, a2, b2, out):
    for x in range(len(out)):
        out[x] = a0[x] * b0[x] + a1[x] * b1[x] + a2[x] * b2[x]


@njit(inline="always")
def _add(out, row):
    for x in range(len(out)):
        out[x] += row[x]


@njit(error_model="numpy")
def _across(row, wide, out):
    """Sums of a row's windows; `wide` is lent."""
    for x in range(len(row)):
        wide[x + RADIUS] = row[x]
    _slide(wide, out)


@njit(error_model="numpy")
def _across_product(a, b, wide, out):
    for x in range(len(a)):
        wide[x + RADIUS] = a[x] * b[x]
    _slide(wide, out)


@njit(error_model="numpy")
def _slide(wide, out):
    last = len(wide) - RADIUS - 1
    for x in range(RADIUS):
        wide[x], wide[last + 1 + x] = wide[RADIUS], wide[last]
    for x in range(len(out)):
        total = wide[x]
        for step in range(1, SIZE):
            total += wide[x + step]
        out[x] = total


@njit(inline="always")
def _down(sums, plane, y, height, out):
    """Means of a row's windows, of the sums [SIZE, P, W] along the last rows."""
    a, b, c = sums[max(y - 3, 0) % SIZE, plane], sums[max(y - 2, 0) % SIZE, plane], sums[max(y - 1, 0) % SIZE, plane]
    d, last = sums[y % SIZE, plane], height - 1
    e, f, g = sums[min(y + 1, last) % SIZE, plane], sums[min(y + 2, last) % SIZE, plane], sums[min(y + 3, last) % SIZE, plane]
    for x in range(len(out)):
        out[x] = (a[x] + b[x] + c[x] + d[x] + e[x] + f[x] + g[x]) * np.float32(1.0 / SIZE**2)
