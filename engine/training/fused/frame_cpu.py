"""The loss of a drawn frame on the CPU, with its gradient: what plain torch does in some sixty passes over the picture.

The gradient is that of the total and is made with it, since nothing else of the loss is asked for one.
"""

from __future__ import annotations

import numpy as np
import torch
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

from degense.engine.simd import LANES, fma, load, mul, splat, store
from degense.engine.threads import run_kernel, take_ticket

C1, C2 = np.float32(1e-4), np.float32(9e-4)  # of SSIM, for values in [0, 1]
L1, STRUCTURE, SQUARE, COLOURS, DEPTH, KNOWN = range(6)  # sums of a row of the picture


@njit(nogil=True, cache=True)
def _moments(image, recorded, visible, moments, shown, counter):
    """x, y, x², y², xy of each colour x that is shown and y that was recorded, into `moments` [H, 5, 3 W]; `shown` [H, 3 W] is 1 where
    they are compared."""
    while True:
        row = take_ticket(counter)
        if row >= image.shape[0]:
            return
        for column in range(image.shape[1]):
            for c in range(3):
                i, y = 3 * column + c, np.float32(recorded[row, column, c]) / np.float32(255)
                x = image[row, column, c] if visible[row, column] else y
                shown[row, i] = visible[row, column]
                moments[row, 0, i], moments[row, 1, i] = x, y
                moments[row, 2, i], moments[row, 3, i], moments[row, 4, i] = x * x, y * y, x * y


@njit(nogil=True, cache=True)
def _blur_row(values, row, window, column_sums, blurred):
    """Row `row` of the pictures `values` [H, N, 3 W] of three channels blurred by `window` along both axes, zeros outside, into `blurred`
    [N, 3 W + `LANES`].

    `column_sums` [3 (W + len(window) - 1) + `LANES`] is room, of which what lies beside the picture must be zero.
    """
    height, pictures, length = values.shape
    half, flat, out = len(window) // 2, values.reshape(-1), blurred.reshape(-1)
    first, last, between = max(row - half, 0), min(row + half, height - 1), pictures * length
    for picture in range(pictures):
        top = first * between + picture * length
        for i in range(0, length - LANES + 1, LANES):
            sums = mul(load(flat, top + i), splat(window[first - row + half]))
            for other in range(1, last - first + 1):
                sums = fma(load(flat, top + other * between + i), splat(window[other + first - row + half]), sums)
            store(column_sums, 3 * half + i, sums)
        for i in range(length - length % LANES, length):
            single = np.float32(0)
            for other in range(last - first + 1):
                single += flat[top + other * between + i] * window[other + first - row + half]
            column_sums[3 * half + i] = single
        for i in range(0, length, LANES):
            sums = mul(load(column_sums, i), splat(window[0]))
            for k in range(1, len(window)):
                sums = fma(load(column_sums, i + 3 * k), splat(window[k]), sums)
            store(out, picture * blurred.shape[1] + i, sums)


@njit(nogil=True, cache=True, error_model="numpy")
def _compare(moments, shown, window, slopes, sums, counter):
    """Sums of each row, and of each colour that is shown −∂SSIM by the means of x, x² and xy, into `slopes` [H, 3, 3 W]."""
    length = moments.shape[2]
    blurred = np.empty((5, length + LANES), np.float32)
    column_sums = np.zeros(length + 3 * (len(window) - 1) + LANES, np.float32)
    two, one = np.float32(2), np.float32(1)
    while True:
        row = take_ticket(counter)
        if row >= moments.shape[0]:
            return
        _blur_row(moments, row, window, column_sums, blurred)
        count, apart, square, structure = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
        for i in range(length):
            mx, my, xx, yy, xy = blurred[0, i], blurred[1, i], blurred[2, i], blurred[3, i], blurred[4, i]
            means, covariance = two * mx * my + C1, two * (xy - mx * my) + C2
            squares, variances = mx * mx + my * my + C1, xx - mx * mx + yy - my * my + C2
            inverse = one / (squares * variances)
            scale = shown[row, i] * inverse
            similarity = means * covariance * scale
            by_mean = two * my * (covariance - means) * scale + two * mx * similarity * (squares - variances) * inverse
            slopes[row, 0, i], slopes[row, 1, i], slopes[row, 2, i] = -by_mean, similarity * squares * inverse, -two * means * scale
            blurred[0, i] = shown[row, i] * (one - similarity)
        for i in range(length):
            difference = moments[row, 0, i] - moments[row, 1, i]  # 0 where nothing is compared
            apart += abs(difference)
            square += difference * difference
            structure += blurred[0, i]
            count += shown[row, i]
        sums[row, COLOURS], sums[row, L1], sums[row, SQUARE], sums[row, STRUCTURE] = count, apart, square, structure


@njit(nogil=True, cache=True)
def _depth(image, alpha, known, visible, sums, grad_image, grad_alpha, counter):
    """Sums of |1/z − 1/z*| of each row, with their gradients."""
    while True:
        row = take_ticket(counter)
        if row >= image.shape[0]:
            return
        for column in range(image.shape[1]):
            cover = alpha[row, column]
            if not (visible[row, column] and known[row, column] > 0 and cover > np.float32(0.5)):
                continue
            expected = image[row, column, 3] / cover
            error = np.float32(1) / max(expected, np.float32(1e-3)) - np.float32(1) / known[row, column]
            sums[row, KNOWN] += 1
            sums[row, DEPTH] += abs(error)
            if expected >= np.float32(1e-3):
                slope = -np.sign(error) / (expected * expected * cover)
                grad_image[row, column, 3] = slope
                grad_alpha[row, column] = -slope * expected


@njit(nogil=True, cache=True)
def _gradient(moments, shown, slopes, window, weights, grad_image, grad_alpha, counter):
    """∂/∂image from the blurred `slopes`; `weights` [3] of a colour's L1, 1 − SSIM and a pixel's depth."""
    length = slopes.shape[2]
    blurred = np.empty((3, length + LANES), np.float32)
    column_sums = np.zeros(length + 3 * (len(window) - 1) + LANES, np.float32)
    two = np.float32(2)
    while True:
        row = take_ticket(counter)
        if row >= slopes.shape[0]:
            return
        _blur_row(slopes, row, window, column_sums, blurred)
        for i in range(length):
            x, y = moments[row, 0, i], moments[row, 1, i]
            structure = blurred[0, i] + two * x * blurred[1, i] + y * blurred[2, i]
            blurred[0, i] = shown[row, i] * (weights[0] * np.sign(x - y) + weights[1] * structure)
        for column in range(grad_alpha.shape[1]):
            for c in range(3):
                grad_image[row, column, c] = blurred[0, 3 * column + c]
            grad_image[row, column, 3] *= weights[2]
            grad_alpha[row, column] *= weights[2]


class _FrameLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx, image, alpha, frame, weights, window):
        recorded, visible, known = (tensor.numpy() for tensor in frame)
        window = window.astype(np.float32)
        drawn, cover = image.detach().contiguous().numpy(), alpha.detach().contiguous().numpy()
        height, width = cover.shape
        grad_image, grad_alpha = torch.zeros(height, width, 4), torch.zeros(height, width)
        moments, slopes = np.empty((height, 5, 3 * width), np.float32), np.empty((height, 3, 3 * width), np.float32)
        rows, shown = np.zeros((height, 6)), np.empty((height, 3 * width), np.float32)
        run_kernel(_moments, drawn, recorded, visible, moments, shown)
        run_kernel(_compare, moments, shown, window, slopes, rows)
        if weights[2] > 0:
            run_kernel(_depth, drawn, cover, known, visible, rows, grad_image.numpy(), grad_alpha.numpy())
        sums = rows.sum(0)
        counts = np.maximum(sums[[COLOURS, COLOURS, KNOWN]], 1)
        share = np.array(weights) / counts
        terms = torch.from_numpy((share * sums[[L1, STRUCTURE, DEPTH]]).astype(np.float32))
        grads = grad_image.numpy(), grad_alpha.numpy()
        run_kernel(_gradient, moments, shown, slopes, window, share.astype(np.float32), *grads)
        ctx.save_for_backward(grad_image, grad_alpha)
        error = torch.tensor(sums[SQUARE] / counts[0], dtype=torch.float32)
        ctx.mark_non_differentiable(terms, error)
        return terms.sum(), terms, error

    @staticmethod
    @once_differentiable
    def backward(ctx, grad, *_):
        grad_image, grad_alpha = ctx.saved_tensors
        return grad_image * grad, grad_alpha * grad, None, None, None


def frame_loss(
    image: Tensor, alpha: Tensor, frame: tuple[Tensor, Tensor, Tensor], weights: tuple[float, float, float], window: np.ndarray
) -> tuple[Tensor, Tensor, Tensor]:
    """The sum of the weighted L1, 1 − SSIM and depth terms of a drawn frame; the three, without gradient; the mean squared error of colour.

    `image`, float32 [H, W, 4], is colour and blended z, `alpha` [H, W] its coverage; `frame` are the tensors of a `Frame`; `window` is that
    of SSIM along one axis. The fused twin of `photometric` and `inverse_depth`.
    """
    return _FrameLoss.apply(image, alpha, frame, weights, window)
