"""The semantic loss of a drawn latent map on the CPU, with its gradient: what plain torch does in some thirty passes over the picture."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

import degense.engine.threads  # noqa: F401 - where compiled kernels are kept

EPSILON = 1e-8  # square of what `engine.training.losses.unit` adds to a length


class Labels(NamedTuple):
    """What the pixels of a frame are compared with."""

    latents: Tensor  # float [k, d]
    latent_of: Tensor  # int32 [P]; the row of the latent of each pixel, −1 for none
    weight: Tensor  # float [P]
    labelled: Tensor  # float []; what the sum is divided by


@njit(nogil=True, cache=True, error_model="numpy")
def _align(drawn, latents, index, weight, labelled, grad):
    """Mean weighted 1 − ⟨u, v⟩ of unit vectors, and its gradient: with u = f / s, s² = ‖f‖² + ε, that is −(v − ⟨u, v⟩ u) / s."""
    total, wide = 0.0, drawn.shape[1]
    targets = np.empty(latents.shape)
    for k in range(len(latents)):
        square = EPSILON
        for c in range(wide):
            square += np.float64(latents[k, c]) * np.float64(latents[k, c])
        for c in range(wide):
            targets[k, c] = latents[k, c] / math.sqrt(square)
    for p in range(len(index)):
        if index[p] < 0:
            continue
        own, target = drawn[p], targets[index[p]]
        square, product = EPSILON, 0.0
        for c in range(wide):
            square += np.float64(own[c]) * np.float64(own[c])
            product += own[c] * target[c]
        inverse = 1.0 / math.sqrt(square)
        cosine = product * inverse
        total += weight[p] * (1.0 - cosine)
        share = weight[p] / labelled * inverse
        for c in range(wide):
            grad[p, c] = share * (cosine * inverse * own[c] - target[c])
    return total / labelled


@njit(nogil=True, cache=True, error_model="numpy")
def _spread(drawn, regions, count, grad):
    """`region_smoothness` and its gradient, (sign(f − f̄) − mean of the signs in the region) / |R|, over the number of regions."""
    wide = drawn.shape[1]
    size, means, signs, spreads = np.zeros(count), np.zeros((count, wide)), np.zeros((count, wide)), np.zeros(count)
    for p in range(len(regions)):
        size[regions[p]] += 1
        for c in range(wide):
            means[regions[p], c] += drawn[p, c]
    number = 0
    for k in range(count):
        number += size[k] > 0
        size[k] = max(size[k], 1.0)
        means[k] /= size[k]
    for p in range(len(regions)):
        k = regions[p]
        for c in range(wide):
            difference = drawn[p, c] - means[k, c]
            spreads[k] += abs(difference)
            signs[k, c] += np.sign(difference)
    number = max(number, 1)
    for p in range(len(regions)):
        k = regions[p]
        for c in range(wide):
            grad[p, c] = (np.sign(drawn[p, c] - means[k, c]) - signs[k, c] / size[k]) / (size[k] * number)
    return (spreads / size).sum() / number


class _Align(torch.autograd.Function):
    @staticmethod
    def forward(ctx, drawn, labels):
        grad = torch.zeros(drawn.shape)
        latents, latent_of, weight, labelled = labels
        arrays = (tensor.numpy() for tensor in (latents, latent_of, weight))
        value = _align(drawn.detach().contiguous().numpy(), *arrays, labelled.item(), grad.numpy())
        ctx.save_for_backward(grad)
        return drawn.new_tensor(value)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad):
        return ctx.saved_tensors[0] * grad, None


class _Spread(torch.autograd.Function):
    @staticmethod
    def forward(ctx, drawn, regions, count):
        grad = torch.empty(drawn.shape)
        value = _spread(drawn.detach().contiguous().numpy(), regions.numpy(), count, grad.numpy())
        ctx.save_for_backward(grad)
        return drawn.new_tensor(value)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad):
        return ctx.saved_tensors[0] * grad, None, None


def align(drawn: Tensor, labels: Labels) -> Tensor:
    """Mean over labelled pixels of their weight times `angular`, float []; `drawn` float32 [P, d]. The fused twin of plain torch."""
    return _Align.apply(drawn, labels)


def region_smoothness(drawn: Tensor, regions: Tensor, count: int) -> Tensor:
    """The fused twin of `engine.training.losses.region_smoothness`; float32 [P, d], `regions` int32 [P]."""
    return _Spread.apply(drawn, regions, count)
