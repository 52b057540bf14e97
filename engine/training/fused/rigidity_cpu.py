"""The rigidity of displacements on the CPU, with its gradient."""

from __future__ import annotations

import math

import numpy as np
import torch
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

from degense.engine.threads import run_kernel, take_ticket

CHUNK = 256  # Gaussians that a ticket stands for


@njit(nogil=True, cache=True)
def _pairs(displacement, neighbours, weights, torn, slopes, grads, sums, counter):
    """`slopes` [N, K, 3] by Δμ_i − Δμ_j of each pair; their sums, `grads` [N, 3]; the sum of the pairs of each chunk."""
    one, floor = np.float32(1), np.float32(1e-12)
    while True:
        chunk = take_ticket(counter)
        if chunk >= sums.shape[0]:
            return
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, displacement.shape[0])):
            x, y, z = displacement[i, 0], displacement[i, 1], displacement[i, 2]
            grads[i, :] = np.float32(0)
            for k in range(neighbours.shape[1]):
                j, weight = neighbours[i, k], weights[i, k]
                dx, dy, dz = x - displacement[j, 0], y - displacement[j, 1], z - displacement[j, 2]
                parted = np.float32(math.sqrt(dx * dx + dy * dy + dz * dz + floor))
                share = one / (one + parted / torn)
                sums[chunk] += weight * parted * share
                slope = weight * share * share / parted
                slopes[i, k, 0], slopes[i, k, 1], slopes[i, k, 2] = slope * dx, slope * dy, slope * dz
                grads[i, 0] += slope * dx
                grads[i, 1] += slope * dy
                grads[i, 2] += slope * dz


@njit(nogil=True, cache=True)
def _take_back(neighbours, slopes, grads, counter):
    """Subtract the slopes of each pair from the gradient of its second Gaussian, one coordinate a ticket."""
    while True:
        c = take_ticket(counter)
        if c >= 3:
            return
        for i in range(neighbours.shape[0]):
            for k in range(neighbours.shape[1]):
                grads[neighbours[i, k], c] -= slopes[i, k, c]


class _Rigidity(torch.autograd.Function):
    @staticmethod
    def forward(ctx, displacement, neighbours, weights, torn):
        moved, index = displacement.detach().contiguous().numpy(), neighbours.numpy()
        slopes, grads = np.empty((*index.shape, 3), np.float32), torch.empty(moved.shape)
        sums = np.zeros(-(-len(moved) // CHUNK))
        run_kernel(_pairs, moved, index, weights.numpy(), np.float32(torn), slopes, grads.numpy(), sums)
        run_kernel(_take_back, index, slopes, grads.numpy())
        ctx.save_for_backward(grads)
        ctx.pairs = max(index.size, 1)
        return torch.tensor(sums.sum() / ctx.pairs, dtype=torch.float32)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad):
        [grads] = ctx.saved_tensors
        return grads * (grad / ctx.pairs), None, None, None


def rigidity(displacement: Tensor, neighbours: Tensor, weights: Tensor, torn: float) -> Tensor:
    """The fused twin of `engine.training.losses.rigidity`: float32 displacements [N, 3], neighbours and weights [N, K]."""
    return _Rigidity.apply(displacement, neighbours, weights, torn)
