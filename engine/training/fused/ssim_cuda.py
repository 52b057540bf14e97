"""Structural similarity on a GPU: two Triton kernels forward and two backward, where plain tensor operations need some forty.

A symmetric window is its own adjoint, so the gradient of the window's means is blurred like the means themselves.
"""

from __future__ import annotations

import torch
import triton
import triton.language as tl
from torch import Tensor

BLOCK = 512


@triton.jit
def _moments(x, y, kernel, out, total, width, channels, TAPS: tl.constexpr, BLOCK: tl.constexpr):
    """x, y, x², y², xy blurred along the rows, [5, H, W, C]."""
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    column = (i // channels) % width
    a = tl.zeros([BLOCK], tl.float32)
    b, aa, bb, ab = a, a, a, a
    for tap in tl.static_range(TAPS):
        offset = tap - TAPS // 2
        there = (i < total) & (column + offset >= 0) & (column + offset < width)
        w = tl.load(kernel + tap)
        p, q = tl.load(x + i + offset * channels, there, 0.0), tl.load(y + i + offset * channels, there, 0.0)
        a += w * p
        b += w * q
        aa += w * p * p
        bb += w * q * q
        ab += w * p * q
    tl.store(out + i, a, i < total)
    tl.store(out + total + i, b, i < total)
    tl.store(out + 2 * total + i, aa, i < total)
    tl.store(out + 3 * total + i, bb, i < total)
    tl.store(out + 4 * total + i, ab, i < total)


@triton.jit
def _similarity(moments, kernel, out, slopes, total, height, row, TAPS: tl.constexpr, BLOCK: tl.constexpr):
    """Blur along the columns, then SSIM and its slopes by the means of x, x² and xy, [3, H, W, C]."""
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    line = i // row
    a = tl.zeros([BLOCK], tl.float32)
    b, aa, bb, ab = a, a, a, a
    for tap in tl.static_range(TAPS):
        offset = tap - TAPS // 2
        there = (i < total) & (line + offset >= 0) & (line + offset < height)
        w = tl.load(kernel + tap)
        j = i + offset * row
        a += w * tl.load(moments + j, there, 0.0)
        b += w * tl.load(moments + total + j, there, 0.0)
        aa += w * tl.load(moments + 2 * total + j, there, 0.0)
        bb += w * tl.load(moments + 3 * total + j, there, 0.0)
        ab += w * tl.load(moments + 4 * total + j, there, 0.0)
    light, contrast = 2 * a * b + 1e-4, 2 * (ab - a * b) + 9e-4
    lights, contrasts = a * a + b * b + 1e-4, aa - a * a + bb - b * b + 9e-4
    value = light * contrast / (lights * contrasts)
    tl.store(out + i, value, i < total)
    by_mean = 2 * b * (contrast - light) / (lights * contrasts) - 2 * a * value * (1 / lights - 1 / contrasts)
    tl.store(slopes + i, by_mean, i < total)
    tl.store(slopes + total + i, -value / contrasts, i < total)
    tl.store(slopes + 2 * total + i, 2 * light / (lights * contrasts), i < total)


@triton.jit
def _slopes_along_rows(slopes, grad, kernel, out, total, width, channels, TAPS: tl.constexpr, BLOCK: tl.constexpr):
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    column = (i // channels) % width
    a = tl.zeros([BLOCK], tl.float32)
    aa, ab = a, a
    for tap in tl.static_range(TAPS):
        offset = tap - TAPS // 2
        there = (i < total) & (column + offset >= 0) & (column + offset < width)
        j = i + offset * channels
        w = tl.load(kernel + tap) * tl.load(grad + j, there, 0.0)
        a += w * tl.load(slopes + j, there, 0.0)
        aa += w * tl.load(slopes + total + j, there, 0.0)
        ab += w * tl.load(slopes + 2 * total + j, there, 0.0)
    tl.store(out + i, a, i < total)
    tl.store(out + total + i, aa, i < total)
    tl.store(out + 2 * total + i, ab, i < total)


@triton.jit
def _gradient(blurred, x, y, kernel, out, total, height, row, TAPS: tl.constexpr, BLOCK: tl.constexpr):
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    line = i // row
    a = tl.zeros([BLOCK], tl.float32)
    aa, ab = a, a
    for tap in tl.static_range(TAPS):
        offset = tap - TAPS // 2
        there = (i < total) & (line + offset >= 0) & (line + offset < height)
        w, j = tl.load(kernel + tap), i + offset * row
        a += w * tl.load(blurred + j, there, 0.0)
        aa += w * tl.load(blurred + total + j, there, 0.0)
        ab += w * tl.load(blurred + 2 * total + j, there, 0.0)
    tl.store(out + i, a + 2 * tl.load(x + i, i < total, 0.0) * aa + tl.load(y + i, i < total, 0.0) * ab, i < total)


class _Similarity(torch.autograd.Function):
    @staticmethod
    def forward(ctx, x, y, kernel):
        x, y = x.contiguous(), y.contiguous()
        (height, width, channels), total = x.shape, x.numel()
        grid, sizes = (triton.cdiv(total, BLOCK),), {"TAPS": len(kernel), "BLOCK": BLOCK}
        moments, slopes, out = x.new_empty(5, total), x.new_empty(3, total), torch.empty_like(x)
        _moments[grid](x, y, kernel, moments, total, width, channels, **sizes)
        _similarity[grid](moments, kernel, out, slopes, total, height, width * channels, **sizes)
        ctx.save_for_backward(x, y, kernel, slopes)
        return out

    @staticmethod
    def backward(ctx, grad):
        x, y, kernel, slopes = ctx.saved_tensors
        (height, width, channels), total = x.shape, x.numel()
        grid, sizes = (triton.cdiv(total, BLOCK),), {"TAPS": len(kernel), "BLOCK": BLOCK}
        blurred, out = torch.empty_like(slopes), torch.empty_like(x)
        _slopes_along_rows[grid](slopes, grad.contiguous(), kernel, blurred, total, width, channels, **sizes)
        _gradient[grid](blurred, x, y, kernel, out, total, height, width * channels, **sizes)
        return out, None, None


def similarity(image: Tensor, target: Tensor, kernel: Tensor) -> Tensor:
    """The fused twin of `engine.training.losses.ssim_map` for float32 [H, W, C] and a window [taps]; no gradient reaches `target`."""
    return _Similarity.apply(image, target.detach(), kernel)
