"""How rough stored planes and curves are, on the CPU: each tensor is read once for all of its regularizers, and once for their gradient."""

from __future__ import annotations

import numpy as np
import torch
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

from degense.engine.simd import LANES, add, fma, load, maximum, splat, sub, total
from degense.engine.threads import run_kernel, take_ticket

ALONG, ACROSS, BEND, APART = range(4)  # kinds of `engine.field.roughness`


@njit(nogil=True, cache=True)
def _sum_of_squares(a, b, c, factor, first, second, third, count):
    """Σ (a[i] + factor b[i] + c[i])² over `count` numbers of flat arrays from the indices `first`, `second` and `third` on."""
    sums, weight = splat(np.float32(0)), splat(factor)
    for i in range(0, count - LANES + 1, LANES):
        value = add(fma(load(b, second + i), weight, load(a, first + i)), load(c, third + i))
        sums = fma(value, value, sums)
    rest = total(sums)
    for i in range(count - count % LANES, count):
        value = a[first + i] + factor * b[second + i] + c[third + i]
        rest += value * value
    return rest


@njit(nogil=True, cache=True)
def _sum_of_distances(values, first, count, centre):
    """Σ |v − centre| over `count` numbers of a flat array from `first` on."""
    sums, middle, none = splat(np.float32(0)), splat(centre), splat(np.float32(0))
    for i in range(0, count - LANES + 1, LANES):
        apart = sub(load(values, first + i), middle)
        sums = add(sums, maximum(apart, sub(none, apart)))
    rest = total(sums)
    for i in range(count - count % LANES, count):
        rest += abs(values[first + i] - centre)
    return rest


@njit(nogil=True, cache=True)
def _forward(values, nothing, asked, centre, sums, counter):
    """`sums` [A · Y, 4] of each row of `values` [A, Y, X, C], of the kinds that are `asked` [4]; `nothing` is zeros of a row's length."""
    height, channels = values.shape[1], values.shape[3]
    length, flat = values.shape[2] * channels, values.reshape(-1)
    less = np.float32(-1)
    while True:
        row = take_ticket(counter)
        if row >= sums.shape[0]:
            return
        y, here = row % height, row * length
        if asked[ALONG]:
            sums[row, ALONG] = _sum_of_squares(flat, flat, nothing, less, here + channels, here, 0, length - channels)
        if asked[ACROSS] and y + 1 < height:
            sums[row, ACROSS] = _sum_of_squares(flat, flat, nothing, less, here + length, here, 0, length)
        if asked[BEND] and 0 < y < height - 1:
            sums[row, BEND] = _sum_of_squares(flat, flat, flat, np.float32(-2), here - length, here, here + length, length)
        if asked[APART]:
            sums[row, APART] = _sum_of_distances(flat, here, length, centre)


@njit(nogil=True, cache=True)
def _backward(values, asked, centre, slopes, grads, counter):
    """`grads` of `values` [A, Y, X, C], where `slopes` [4] are those of the squares, and of the distances, of each kind."""
    planes, height, width, channels = values.shape
    along, across, bend, apart = slopes[ALONG], slopes[ACROSS], slopes[BEND], slopes[APART]
    two = np.float32(2)
    length = width * channels
    rows = values.reshape(planes * height, length)
    out = grads.reshape(planes * height, length)
    while True:
        row = take_ticket(counter)
        if row >= planes * height:
            return
        y, here, grad = row % height, rows[row], out[row]
        for i in range(length):
            grad[i] = apart * np.sign(here[i] - centre)
        if asked[ALONG]:
            for i in range(channels, length):
                grad[i] += along * (here[i] - here[i - channels])
            for i in range(length - channels):
                grad[i] += along * (here[i] - here[i + channels])
        if asked[ACROSS]:
            for other in (row - 1, row + 1):
                if 0 <= y + other - row < height:
                    for i in range(length):
                        grad[i] += across * (here[i] - rows[other, i])
        if asked[BEND]:
            for middle in range(max(y - 1, 1), min(y + 1, height - 2) + 1):  # of the second differences that this row has a part in
                at, weight = row + middle - y, bend if middle != y else -two * bend
                for i in range(length):
                    grad[i] += weight * (rows[at - 1, i] - two * rows[at, i] + rows[at + 1, i])


class _Roughness(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values, asked, centre):
        values = values.contiguous()
        planes, height, width, channels = values.shape
        sums = np.zeros((planes * height, 4), np.float32)
        centre, nothing = np.float32(centre), np.zeros(width * channels, np.float32)
        run_kernel(_forward, values.detach().numpy(), nothing, asked, centre, sums)
        pairs = planes * np.array([height * (width - 1), (height - 1) * width, (height - 2) * width, height * width])
        ctx.save_for_backward(values)
        ctx.asked, ctx.centre, ctx.counts = asked, centre, np.maximum(pairs * channels, 1)
        return torch.from_numpy((sums.sum(0, dtype=np.float64) / ctx.counts).astype(np.float32))

    @staticmethod
    @once_differentiable
    def backward(ctx, grad):
        [values] = ctx.saved_tensors
        slopes = (ctx.asked * grad.numpy() * np.array([2, 2, 2, 1]) / ctx.counts).astype(np.float32)
        grads = torch.empty_like(values)
        run_kernel(_backward, values.detach().numpy(), ctx.asked, ctx.centre, slopes, grads.numpy())
        return grads, None, None


def roughness(values: Tensor, kinds: tuple[int, ...], centre: float) -> Tensor:
    """The four kinds, [4], of float32 values [A, Y, X, C]: the fused twin of `engine.field.roughness.plain_roughness`."""
    return _Roughness.apply(values, np.isin(np.arange(4), kinds), centre)
