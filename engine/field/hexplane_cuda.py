"""One HexPlane level on a GPU: the six look-ups, their product, and the scatter of its gradient, one Triton kernel each way.

Many points share a cell of a line, few one of a plane: gradients of lines are summed in several copies, so that atomic additions seldom
meet.
"""

from __future__ import annotations

import torch
import triton
import triton.language as tl
from torch import Tensor

POINTS = 32  # a program's
COPIES = 32  # of the lines' gradient


@triton.jit
def _corner(place, width):
    """Cell and fraction of a coordinate in [-1, 1]."""
    scaled = (place + 1.0) * (0.5 * (width - 1))
    cell = tl.maximum(tl.minimum(scaled.to(tl.int32), width - 2), 0)
    return cell, scaled - cell


@triton.jit
def _plane(space, number, row, column, fr, fc, width, channels, c, mask):
    """Bilinear sample of one plane and the address of its first corner."""
    base = space + ((number * width + row) * width + column)[:, None] * channels + c[None, :]
    top = (1 - fc)[:, None] * tl.load(base, mask, 0.0) + fc[:, None] * tl.load(base + channels, mask, 0.0)
    low = base + width * channels
    bottom = (1 - fc)[:, None] * tl.load(low, mask, 0.0) + fc[:, None] * tl.load(low + channels, mask, 0.0)
    return (1 - fr)[:, None] * top + fr[:, None] * bottom


@triton.jit
def _line(line, number, cell, fraction, width, channels, c, mask):
    base = line + (number * width + cell)[:, None] * channels + c[None, :]
    return (1 - fraction)[:, None] * tl.load(base, mask, 0.0) + fraction[:, None] * tl.load(base + channels, mask, 0.0)


@triton.jit
def _add_plane(space, number, row, column, fr, fc, width, channels, c, mask, value):
    base = space + ((number * width + row) * width + column)[:, None] * channels + c[None, :]
    low = base + width * channels
    tl.atomic_add(base, ((1 - fr) * (1 - fc))[:, None] * value, mask, sem="relaxed")
    tl.atomic_add(base + channels, ((1 - fr) * fc)[:, None] * value, mask, sem="relaxed")
    tl.atomic_add(low, (fr * (1 - fc))[:, None] * value, mask, sem="relaxed")
    tl.atomic_add(low + channels, (fr * fc)[:, None] * value, mask, sem="relaxed")


@triton.jit
def _add_line(line, number, cell, fraction, width, channels, c, mask, value):
    base = line + (number * width + cell)[:, None] * channels + c[None, :]
    tl.atomic_add(base, (1 - fraction)[:, None] * value, mask, sem="relaxed")
    tl.atomic_add(base + channels, fraction[:, None] * value, mask, sem="relaxed")


@triton.jit
def _forward(points, space, line, out, count, width, channels, WIDE: tl.constexpr, BLOCK: tl.constexpr):
    n = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    c = tl.arange(0, WIDE)
    mask = (n < count)[:, None] & (c < channels)[None, :]
    x, fx = _corner(tl.load(points + 3 * n, n < count, 0.0), width)
    y, fy = _corner(tl.load(points + 3 * n + 1, n < count, 0.0), width)
    z, fz = _corner(tl.load(points + 3 * n + 2, n < count, 0.0), width)
    value = _plane(space, 0, y, x, fy, fx, width, channels, c, mask)
    value *= _plane(space, 1, z, x, fz, fx, width, channels, c, mask)
    value *= _plane(space, 2, z, y, fz, fy, width, channels, c, mask)
    value *= _line(line, 0, x, fx, width, channels, c, mask)
    value *= _line(line, 1, y, fy, width, channels, c, mask)
    value *= _line(line, 2, z, fz, width, channels, c, mask)
    tl.store(out + n[:, None] * channels + c[None, :], value, mask)


@triton.jit
def _backward(points, space, line, grad, grad_space, grad_line, count, width, channels, copies, WIDE: tl.constexpr, BLOCK: tl.constexpr):
    n = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    c = tl.arange(0, WIDE)
    mask = (n < count)[:, None] & (c < channels)[None, :]
    x, fx = _corner(tl.load(points + 3 * n, n < count, 0.0), width)
    y, fy = _corner(tl.load(points + 3 * n + 1, n < count, 0.0), width)
    z, fz = _corner(tl.load(points + 3 * n + 2, n < count, 0.0), width)
    p = _plane(space, 0, y, x, fy, fx, width, channels, c, mask)
    q = _plane(space, 1, z, x, fz, fx, width, channels, c, mask)
    r = _plane(space, 2, z, y, fz, fy, width, channels, c, mask)
    e = _line(line, 0, x, fx, width, channels, c, mask)
    f = _line(line, 1, y, fy, width, channels, c, mask)
    g = _line(line, 2, z, fz, width, channels, c, mask)
    up = tl.load(grad + n[:, None] * channels + c[None, :], mask, 0.0)
    lines, planes = up * e * f * g, up * p * q * r
    _add_plane(grad_space, 0, y, x, fy, fx, width, channels, c, mask, q * r * lines)
    _add_plane(grad_space, 1, z, x, fz, fx, width, channels, c, mask, p * r * lines)
    _add_plane(grad_space, 2, z, y, fz, fy, width, channels, c, mask, p * q * lines)
    copy = grad_line + (tl.program_id(0) % copies) * (3 * width * channels)
    _add_line(copy, 0, x, fx, width, channels, c, mask, f * g * planes)
    _add_line(copy, 1, y, fy, width, channels, c, mask, e * g * planes)
    _add_line(copy, 2, z, fz, width, channels, c, mask, e * f * planes)


class _Sample(torch.autograd.Function):
    @staticmethod
    def forward(ctx, points, space, line):
        points, space, line = points.contiguous(), space.contiguous(), line.contiguous()
        count, (_, width, _, channels) = len(points), space.shape
        out = torch.empty(count, channels, device=points.device)
        if count:
            wide = triton.next_power_of_2(channels)
            _forward[(triton.cdiv(count, POINTS),)](points, space, line, out, count, width, channels, WIDE=wide, BLOCK=POINTS)
        ctx.save_for_backward(points, space, line)
        return out

    @staticmethod
    def backward(ctx, grad):
        points, space, line = ctx.saved_tensors
        count, (_, width, _, channels) = len(points), space.shape
        grad_space, grad_lines = torch.zeros_like(space), line.new_zeros(COPIES, *line.shape)
        if count:
            wide = triton.next_power_of_2(channels)
            arrays = (points, space, line, grad.contiguous(), grad_space, grad_lines)
            _backward[(triton.cdiv(count, POINTS),)](*arrays, count, width, channels, COPIES, WIDE=wide, BLOCK=POINTS)
        return None, grad_space, grad_lines.sum(0)


def sample(points: Tensor, space: Tensor, line: Tensor) -> Tensor:
    """Features float32 [N, C] of `points` [N, 3] in [-1, 1]; the fused twin of `engine.field.hexplane.sample_level`."""
    return _Sample.apply(points, space, line)
