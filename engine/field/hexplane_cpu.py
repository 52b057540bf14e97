"""The HexPlane on the CPU: a level's six look-ups, their product, and the scatter of its gradient, fused in numba.

Threads share the work by channels, so that no two of them ever write to the same cell and the result does not depend on their timing. The
kernels are compiled without `fastmath`: with it, one just compiled and the same one read back from numba's cache differ in their last bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, chain

import numpy as np
import torch
from numba import njit
from torch import Tensor

from degense.engine.threads import run_kernel, take_ticket

CHUNK = 256  # points a ticket stands for
BLOCK = 8  # channels a task handles at once: one 256-bit register; a plane's channels are a multiple of it


@njit(cache=True, nogil=True, inline="always")
def _six(space, line, x, y, z, fx, fy, fz, c):
    """The six samples of channel `c` in the cell (x, y, z), at the fractions (fx, fy, fz) of it: planes xy, xz, yz, then lines x, y, z.

    Without a sign numba need not ask whether an index counts from the end: a third of the time.
    """
    x, y, z, c, one = np.uintp(x), np.uintp(y), np.uintp(z), np.uintp(c), np.uintp(1)
    gx, gy, gz = np.float32(1) - fx, np.float32(1) - fy, np.float32(1) - fz
    a = gy * (gx * space[0, y, x, c] + fx * space[0, y, x + one, c]) + fy * (
        gx * space[0, y + one, x, c] + fx * space[0, y + one, x + one, c]
    )
    b = gz * (gx * space[1, z, x, c] + fx * space[1, z, x + one, c]) + fz * (
        gx * space[1, z + one, x, c] + fx * space[1, z + one, x + one, c]
    )
    d = gz * (gy * space[2, z, y, c] + fy * space[2, z, y + one, c]) + fz * (
        gy * space[2, z + one, y, c] + fy * space[2, z + one, y + one, c]
    )
    e = gx * line[0, x, c] + fx * line[0, x + one, c]
    f = gy * line[1, y, c] + fy * line[1, y + one, c]
    g = gz * line[2, z, c] + fz * line[2, z + one, c]
    return a, b, d, e, f, g


@njit(cache=True, nogil=True)
def sample_rows(points, space, line, out, first):
    """One level: the features of `points` [N, 3], into the columns of `out` [N, all levels' channels] from `first` on."""
    width, channels = space.shape[1], space.shape[3]
    half = np.float32(0.5 * (width - 1))
    for n in range(points.shape[0]):
        px, py, pz = (points[n, 0] + 1) * half, (points[n, 1] + 1) * half, (points[n, 2] + 1) * half
        x, y, z = min(int(px), width - 2), min(int(py), width - 2), min(int(pz), width - 2)
        fx, fy, fz = np.float32(px - x), np.float32(py - y), np.float32(pz - z)
        row = out[n, first : first + channels]
        for c in range(channels):
            a, b, d, e, f, g = _six(space, line, x, y, z, fx, fy, fz, c)
            row[c] = a * b * d * e * f * g


@njit(cache=True, nogil=True)
def _forward(points, space, line, out, first, counter):
    while True:
        begin = take_ticket(counter) * CHUNK
        if begin >= points.shape[0]:
            return
        sample_rows(points[begin : begin + CHUNK], space, line, out[begin : begin + CHUNK], first)


@njit(cache=True, nogil=True, inline="always")
def _scatter(row, first, values, weight):
    for c in range(BLOCK):
        row[first + c] += values[c] * weight


@njit(cache=True, nogil=True)
def _backward(points, space, line, grad, first_of_level, grad_space, grad_line, counter):
    count, width, channels = points.shape[0], space.shape[1], space.shape[3]
    half = np.float32(0.5 * (width - 1))
    ga, gb, gd = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    ge, gf, gg = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    while True:
        first = take_ticket(counter) * BLOCK
        if first >= channels:
            return
        for n in range(count):
            px, py, pz = (points[n, 0] + 1) * half, (points[n, 1] + 1) * half, (points[n, 2] + 1) * half
            x, y, z = min(int(px), width - 2), min(int(py), width - 2), min(int(pz), width - 2)
            fx, fy, fz = np.float32(px - x), np.float32(py - y), np.float32(pz - z)
            gx, gy, gz = np.float32(1) - fx, np.float32(1) - fy, np.float32(1) - fz
            for i in range(BLOCK):
                c = first + i
                a, b, d, e, f, g = _six(space, line, x, y, z, fx, fy, fz, c)
                up = grad[n, first_of_level + c]
                planes, lines = a * b * d, e * f * g
                ga[i], gb[i], gd[i] = up * b * d * lines, up * a * d * lines, up * a * b * lines
                ge[i], gf[i], gg[i] = up * planes * f * g, up * planes * e * g, up * planes * e * f
            _scatter(grad_space[0, y, x], first, ga, gy * gx)
            _scatter(grad_space[0, y, x + 1], first, ga, gy * fx)
            _scatter(grad_space[0, y + 1, x], first, ga, fy * gx)
            _scatter(grad_space[0, y + 1, x + 1], first, ga, fy * fx)
            _scatter(grad_space[1, z, x], first, gb, gz * gx)
            _scatter(grad_space[1, z, x + 1], first, gb, gz * fx)
            _scatter(grad_space[1, z + 1, x], first, gb, fz * gx)
            _scatter(grad_space[1, z + 1, x + 1], first, gb, fz * fx)
            _scatter(grad_space[2, z, y], first, gd, gz * gy)
            _scatter(grad_space[2, z, y + 1], first, gd, gz * fy)
            _scatter(grad_space[2, z + 1, y], first, gd, fz * gy)
            _scatter(grad_space[2, z + 1, y + 1], first, gd, fz * fy)
            _scatter(grad_line[0, x], first, ge, gx)
            _scatter(grad_line[0, x + 1], first, ge, fx)
            _scatter(grad_line[1, y], first, gf, gy)
            _scatter(grad_line[1, y + 1], first, gf, fy)
            _scatter(grad_line[2, z], first, gg, gz)
            _scatter(grad_line[2, z + 1], first, gg, fz)


class _Sample(torch.autograd.Function):
    @staticmethod
    def forward(ctx, points, *levels):
        points, levels = points.contiguous(), tuple(plane.contiguous() for plane in levels)
        ctx.starts = [0, *accumulate(space.shape[3] for space in levels[::2])]
        out = torch.empty(points.shape[0], ctx.starts[-1])
        for start, space, line in zip(ctx.starts, levels[::2], levels[1::2], strict=False):
            run_kernel(_forward, points.numpy(), space.detach().numpy(), line.detach().numpy(), out.numpy(), start)
        ctx.save_for_backward(points, *levels)
        return out

    @staticmethod
    def backward(ctx, grad):
        points, *levels = ctx.saved_tensors
        planes, grad = [plane.detach().numpy() for plane in levels], grad.contiguous().numpy()
        grads = [torch.zeros_like(plane) for plane in levels]
        for i, start in zip(range(0, len(planes), 2), ctx.starts, strict=False):
            run_kernel(_backward, points.numpy(), planes[i], planes[i + 1], grad, start, grads[i].numpy(), grads[i + 1].numpy())
        return None, *grads


def sample(points: Tensor, spaces: Sequence[Tensor], lines: Sequence[Tensor]) -> Tensor:
    """Features float32 [N, all levels' channels] of `points` [N, 3] in [-1, 1]; the fused twin of `engine.field.hexplane.sample_levels`."""
    return _Sample.apply(points, *chain.from_iterable(zip(spaces, lines, strict=True)))
