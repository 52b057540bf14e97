"""One HexPlane level on the CPU: the six look-ups, their product, and the scatter of its gradient, fused in numba.

Threads share the work by channels, so that no two of them ever write to the same cell and the result does not depend on their timing.
"""

from __future__ import annotations

import numpy as np
import torch
from numba import njit
from torch import Tensor

from engine.threads import run_kernel, take_ticket

CHUNK = 256  # points a ticket stands for
BLOCK = 8  # channels a task handles at once: one 256-bit register; a plane's channels are a multiple of it


@njit(fastmath=True, cache=True, nogil=True, inline="always")
def _six(space, line, x, y, z, fx, fy, fz, c):
    """The six samples of channel `c` in the cell (x, y, z), at the fractions (fx, fy, fz) of it: planes xy, xz, yz, then lines x, y, z."""
    gx, gy, gz = np.float32(1) - fx, np.float32(1) - fy, np.float32(1) - fz
    a = gy * (gx * space[0, y, x, c] + fx * space[0, y, x + 1, c]) + fy * (gx * space[0, y + 1, x, c] + fx * space[0, y + 1, x + 1, c])
    b = gz * (gx * space[1, z, x, c] + fx * space[1, z, x + 1, c]) + fz * (gx * space[1, z + 1, x, c] + fx * space[1, z + 1, x + 1, c])
    d = gz * (gy * space[2, z, y, c] + fy * space[2, z, y + 1, c]) + fz * (gy * space[2, z + 1, y, c] + fy * space[2, z + 1, y + 1, c])
    e = gx * line[0, x, c] + fx * line[0, x + 1, c]
    f = gy * line[1, y, c] + fy * line[1, y + 1, c]
    g = gz * line[2, z, c] + fz * line[2, z + 1, c]
    return a, b, d, e, f, g


@njit(fastmath=True, cache=True, nogil=True)
def _forward(points, space, line, out, counter):
    count, width, channels = points.shape[0], space.shape[1], space.shape[3]
    half = np.float32(0.5 * (width - 1))
    while True:
        begin = take_ticket(counter) * CHUNK
        if begin >= count:
            return
        for n in range(begin, min(begin + CHUNK, count)):
            px, py, pz = (points[n, 0] + 1) * half, (points[n, 1] + 1) * half, (points[n, 2] + 1) * half
            x, y, z = min(int(px), width - 2), min(int(py), width - 2), min(int(pz), width - 2)
            fx, fy, fz = np.float32(px - x), np.float32(py - y), np.float32(pz - z)
            for c in range(channels):
                a, b, d, e, f, g = _six(space, line, x, y, z, fx, fy, fz, c)
                out[n, c] = a * b * d * e * f * g


@njit(fastmath=True, cache=True, nogil=True, inline="always")
def _scatter(row, first, values, weight):
    for c in range(BLOCK):
        row[first + c] += values[c] * weight


@njit(fastmath=True, cache=True, nogil=True)
def _backward(points, space, line, grad, grad_space, grad_line, counter):
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
                up = grad[n, c]
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
    def forward(ctx, points, space, line):
        points, space, line = points.contiguous(), space.contiguous(), line.contiguous()
        out = torch.empty(points.shape[0], space.shape[3])
        run_kernel(_forward, points.numpy(), space.detach().numpy(), line.detach().numpy(), out.numpy())
        ctx.save_for_backward(points, space, line)
        return out

    @staticmethod
    def backward(ctx, grad):
        points, space, line = ctx.saved_tensors
        grad_space, grad_line = torch.zeros_like(space), torch.zeros_like(line)
        arrays = (points, space.detach(), line.detach(), grad.contiguous(), grad_space, grad_line)
        run_kernel(_backward, *(array.numpy() for array in arrays))
        return None, grad_space, grad_line


def sample(points: Tensor, space: Tensor, line: Tensor) -> Tensor:
    """Features float32 [N, C] of `points` [N, 3] in [-1, 1]; the fused twin of `engine.field.hexplane.sample_level`."""
    return _Sample.apply(points, space, line)
