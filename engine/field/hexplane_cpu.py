"""The HexPlane on the CPU: a level's six look-ups, their product, and the scatter of its gradient, fused in numba.

Backwards threads share the work by levels, so that no two of them ever write to the same cell, nor to the same line of the cache, and the
result does not depend on their timing. The kernels are compiled without `fastmath`: with it, one just compiled and the same one read back
from numba's cache differ in their last bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, chain

import numpy as np
import torch
from numba import njit
from torch import Tensor

from degense.engine.simd import HALF, fma, load_half, mul, splat_half, store
from degense.engine.threads import run_kernel, take_ticket

CHUNK = 256  # points a ticket stands for
BLOCK = HALF  # channels a task handles at once; a plane's channels are a multiple of it


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
def _corner_weights(fx, fy):
    """What the four corners of a cell weigh at the fractions (fx, fy) of it: a row, then the next."""
    gx, gy = np.float32(1) - fx, np.float32(1) - fy
    return splat_half(gy * gx), splat_half(gy * fx), splat_half(fy * gx), splat_half(fy * fx)


@njit(cache=True, nogil=True, inline="always")
def _of_cell(plane, corner, right, down, weights):
    """A block of a flat plane in the cell at the index `corner`; its neighbours are so many numbers to the right and down."""
    w0, w1, w2, w3 = weights
    sums = fma(load_half(plane, corner + right), w1, mul(load_half(plane, corner), w0))
    return fma(load_half(plane, corner + down + right), w3, fma(load_half(plane, corner + down), w2, sums))


@njit(cache=True, nogil=True, inline="always")
def _of_line(line, knot, right, near, far):
    """A block of a flat line between the knot at an index and the next."""
    return fma(load_half(line, knot + right), far, mul(load_half(line, knot), near))


@njit(cache=True, nogil=True, inline="always")
def _add(flat, index, values, weight):
    store(flat, index, fma(values, weight, load_half(flat, index)))


@njit(cache=True, nogil=True, inline="always")
def _add_to_cell(plane, corner, right, down, weights, values):
    """The adjoint of `_of_cell`."""
    w0, w1, w2, w3 = weights
    _add(plane, corner, values, w0)
    _add(plane, corner + right, values, w1)
    _add(plane, corner + down, values, w2)
    _add(plane, corner + down + right, values, w3)


@njit(cache=True, nogil=True, inline="always")
def _add_to_line(line, knot, right, near, far, values):
    """The adjoint of `_of_line`."""
    _add(line, knot, values, near)
    _add(line, knot + right, values, far)


@njit(cache=True, nogil=True)
def _backward_level(points, space, line, grad, first_of_level, grad_space, grad_line):
    width, channels = space.shape[1], space.shape[3]
    planes, lines, ups, grad_planes, grad_lines = (
        space.reshape(-1), line.reshape(-1), grad.reshape(-1), grad_space.reshape(-1), grad_line.reshape(-1)
    )  # fmt: skip
    half, one = np.float32(0.5 * (width - 1)), np.float32(1)
    across, plane = width * channels, width * width * channels  # numbers from a row to the next, and from a plane to the next
    for n in range(points.shape[0]):
        px, py, pz = (points[n, 0] + one) * half, (points[n, 1] + one) * half, (points[n, 2] + one) * half
        x, y, z = min(int(px), width - 2), min(int(py), width - 2), min(int(pz), width - 2)
        fx, fy, fz = np.float32(px - x), np.float32(py - y), np.float32(pz - z)
        in_xy, in_xz, in_yz = _corner_weights(fx, fy), _corner_weights(fx, fz), _corner_weights(fy, fz)
        gx, gy, gz = splat_half(one - fx), splat_half(one - fy), splat_half(one - fz)
        hx, hy, hz = splat_half(fx), splat_half(fy), splat_half(fz)
        for first in range(0, channels, BLOCK):
            xy, xz, yz = first + (y * width + x) * channels, first + (z * width + x) * channels, first + (z * width + y) * channels
            xz, yz, kx, ky, kz = xz + plane, yz + 2 * plane, first + x * channels, first + y * channels, first + z * channels
            ky, kz = ky + across, kz + 2 * across
            a, b, d = (
                _of_cell(planes, xy, channels, across, in_xy), _of_cell(planes, xz, channels, across, in_xz),
                _of_cell(planes, yz, channels, across, in_yz),
            )  # fmt: skip
            e, f, g = _of_line(lines, kx, channels, gx, hx), _of_line(lines, ky, channels, gy, hy), _of_line(lines, kz, channels, gz, hz)
            up, ab, ef = load_half(ups, n * grad.shape[1] + first_of_level + first), mul(a, b), mul(e, f)
            of_space, of_time = mul(mul(ab, d), up), mul(mul(ef, g), up)
            _add_to_cell(grad_planes, xy, channels, across, in_xy, mul(mul(b, d), of_time))
            _add_to_cell(grad_planes, xz, channels, across, in_xz, mul(mul(a, d), of_time))
            _add_to_cell(grad_planes, yz, channels, across, in_yz, mul(ab, of_time))
            _add_to_line(grad_lines, kx, channels, gx, hx, mul(of_space, mul(f, g)))
            _add_to_line(grad_lines, ky, channels, gy, hy, mul(of_space, mul(e, g)))
            _add_to_line(grad_lines, kz, channels, gz, hz, mul(of_space, ef))


@njit(cache=True, nogil=True)
def _backward(points, spaces, lines, grad, starts, grad_spaces, grad_lines, counter):
    while True:
        level = take_ticket(counter)
        if level >= len(spaces):
            return
        _backward_level(points, spaces[level], lines[level], grad, starts[level], grad_spaces[level], grad_lines[level])


class _Sample(torch.autograd.Function):
    @staticmethod
    def forward(ctx, queries, *planes):
        """`planes` are the space planes by level, then the lines by level of each of the `queries`, points [N, 3], one after the other."""
        levels = len(planes) // (1 + len(queries))
        queries, planes = [points.contiguous() for points in queries], tuple(plane.contiguous() for plane in planes)
        arrays = [tuple(plane.detach().numpy() for plane in planes[i : i + levels]) for i in range(0, len(planes), levels)]
        starts = np.array([0, *accumulate(space.shape[3] for space in arrays[0])])
        rows = [0, *accumulate(len(points) for points in queries)]
        out = torch.empty(rows[-1], starts[-1])
        for points, lines, first, last in zip(queries, arrays[1:], rows, rows[1:], strict=False):
            for space, line, start in zip(arrays[0], lines, starts, strict=False):
                run_kernel(_forward, points.numpy(), space, line, out[first:last].numpy(), start)
        ctx.save_for_backward(*queries, *planes)
        ctx.starts, ctx.rows, ctx.levels = starts, rows, levels
        return out

    @staticmethod
    def backward(ctx, grad):
        queries, planes = ctx.saved_tensors[: len(ctx.rows) - 1], ctx.saved_tensors[len(ctx.rows) - 1 :]
        grads, levels = [torch.zeros_like(plane) for plane in planes], ctx.levels
        read, written = (
            [tuple(plane.detach().numpy() for plane in of[i : i + levels]) for i in range(0, len(of), levels)] for of in (planes, grads)
        )
        flat = grad.contiguous().numpy()
        for i, points in enumerate(queries):
            slopes = flat[ctx.rows[i] : ctx.rows[i + 1]]
            run_kernel(_backward, points.numpy(), read[0], read[1 + i], slopes, ctx.starts, written[0], written[1 + i])
        return None, *grads


def sample(queries: Sequence[Tensor], spaces: Sequence[Tensor], lines: Sequence[Sequence[Tensor]]) -> Tensor:
    """Features float32 [ΣN, all levels' channels] of the points [N, 3] in [-1, 1] of each query, with its own lines: the fused twin of
    `engine.field.hexplane.sample_levels` of one query after the other."""
    return _Sample.apply(queries, *spaces, *chain.from_iterable(lines))
