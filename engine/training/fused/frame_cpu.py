"""The loss of a drawn frame on the CPU, with its gradient: what plain torch does in some sixty passes over the picture.

The gradient is that of the total and is made with it, since nothing else of the loss is asked for one.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

from degense.engine.threads import run_kernel, take_ticket

C1, C2 = np.float32(1e-4), np.float32(9e-4)  # of SSIM, for values in [0, 1]
L1, STRUCTURE, SQUARE, VALID, DEPTH, KNOWN = range(6)  # sums of a row of the picture


@njit(nogil=True, cache=True)
def _moments(image, recorded, visible, moments, counter):
    """x, y, x², y², xy of each colour x that is shown and y that was recorded, into `moments` [H, W, 15]."""
    while True:
        row = take_ticket(counter)
        if row >= image.shape[0]:
            return
        for column in range(image.shape[1]):
            for c in range(3):
                y = np.float32(recorded[row, column, c]) / np.float32(255)
                x = image[row, column, c] if visible[row, column] else y
                moments[row, column, c], moments[row, column, 3 + c] = x, y
                moments[row, column, 6 + c], moments[row, column, 9 + c], moments[row, column, 12 + c] = x * x, y * y, x * y


@njit(nogil=True, cache=True)
def _compare(image, recorded, visible, blurred, slopes, sums, counter):
    """Sums of each row, and of each valid pixel −∂SSIM by the means of x, x² and xy, into `slopes` [H, W, 9]."""
    two = np.float32(2)
    while True:
        row = take_ticket(counter)
        if row >= image.shape[0]:
            return
        for column in range(image.shape[1]):
            if not visible[row, column]:
                slopes[row, column, :] = 0
                continue
            sums[row, VALID] += 1
            for c in range(3):
                difference = image[row, column, c] - np.float32(recorded[row, column, c]) / np.float32(255)
                sums[row, L1] += abs(difference)
                sums[row, SQUARE] += difference * difference
                mx, my = blurred[row, column, c], blurred[row, column, 3 + c]
                xx, yy, xy = blurred[row, column, 6 + c], blurred[row, column, 9 + c], blurred[row, column, 12 + c]
                means, covariance = two * mx * my + C1, two * (xy - mx * my) + C2
                squares, variances = mx * mx + my * my + C1, xx - mx * mx + yy - my * my + C2
                scale = np.float32(1) / (squares * variances)
                similarity = means * covariance * scale
                sums[row, STRUCTURE] += np.float32(1) - similarity
                by_mean = two * my * (covariance - means) * scale + two * mx * similarity * (squares - variances) * scale
                slopes[row, column, c] = -by_mean
                slopes[row, column, 3 + c] = similarity * squares * scale
                slopes[row, column, 6 + c] = -two * means * scale


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
def _gradient(image, recorded, visible, slopes, weights, grad_image, grad_alpha, counter):
    """∂/∂image from `slopes` that were blurred; `weights` [3] of a pixel's L1, 1 − SSIM and depth."""
    while True:
        row = take_ticket(counter)
        if row >= image.shape[0]:
            return
        for column in range(image.shape[1]):
            grad_image[row, column, 3] *= weights[2]
            grad_alpha[row, column] *= weights[2]
            for c in range(3):
                x, y = image[row, column, c], np.float32(recorded[row, column, c]) / np.float32(255)
                structure = slopes[row, column, c] + 2 * x * slopes[row, column, 3 + c] + y * slopes[row, column, 6 + c]
                value = weights[0] * np.sign(x - y) + weights[1] * structure
                grad_image[row, column, c] = value if visible[row, column] else np.float32(0)


class _FrameLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx, image, alpha, frame, weights, window):
        recorded, visible, known = (tensor.numpy() for tensor in frame)
        drawn, cover = image.detach().contiguous().numpy(), alpha.detach().contiguous().numpy()
        height, width = cover.shape
        grad_image, grad_alpha = torch.zeros(height, width, 4), torch.zeros(height, width)
        rows, slopes = np.zeros((height, 6)), np.empty((height, width, 9), np.float32)
        moments = np.empty((height, width, 15), np.float32)
        run_kernel(_moments, drawn, recorded, visible, moments)
        run_kernel(_compare, drawn, recorded, visible, _blurred(moments, window), slopes, rows)
        if weights[2] > 0:
            run_kernel(_depth, drawn, cover, known, visible, rows, grad_image.numpy(), grad_alpha.numpy())
        sums = rows.sum(0)
        counts = np.maximum(sums[[VALID, VALID, KNOWN]] * (3, 3, 1), (3, 3, 1))
        share = np.array(weights) / counts
        terms = torch.from_numpy((share * sums[[L1, STRUCTURE, DEPTH]]).astype(np.float32))
        run_kernel(
            _gradient, drawn, recorded, visible, _blurred(slopes, window), share.astype(np.float32), grad_image.numpy(), grad_alpha.numpy()
        )
        ctx.save_for_backward(grad_image, grad_alpha)
        error = torch.tensor(sums[SQUARE] / counts[0], dtype=torch.float32)
        ctx.mark_non_differentiable(terms, error)
        return terms.sum(), terms, error

    @staticmethod
    @once_differentiable
    def backward(ctx, grad, *_):
        grad_image, grad_alpha = ctx.saved_tensors
        return grad_image * grad, grad_alpha * grad, None, None, None


def _blurred(values: np.ndarray, window: np.ndarray) -> np.ndarray:
    return cv2.sepFilter2D(values, -1, window, window, borderType=cv2.BORDER_CONSTANT)


def frame_loss(
    image: Tensor, alpha: Tensor, frame: tuple[Tensor, Tensor, Tensor], weights: tuple[float, float, float], window: np.ndarray
) -> tuple[Tensor, Tensor, Tensor]:
    """The sum of the weighted L1, 1 − SSIM and depth terms of a drawn frame; the three, without gradient; the mean squared error of colour.

    `image`, float32 [H, W, 4], is colour and blended z, `alpha` [H, W] its coverage; `frame` are the tensors of a `Frame`; `window` is that
    of SSIM along one axis. The fused twin of `photometric` and `inverse_depth`.
    """
    return _FrameLoss.apply(image, alpha, frame, weights, window)
