"""Votes of regions on the CPU: plain torch takes the exponential of every pair of regions, of which few are near each other."""

from __future__ import annotations

import math

import numpy as np
import torch
from numba import njit
from torch import Tensor

from degense.engine.threads import run_kernel, take_ticket

FARTHEST = 40.0  # squared distance beyond that of the nearest at which a region counts e^(−20) of it, which is nothing


@njit(nogil=True, cache=True, error_model="numpy")
def _votes(asked, traits, sums, votes, counter):
    """Fill `votes` [K, words], zeros; `asked` [K, 6], `traits` [6, S], `sums` [S, words]."""
    distance = np.empty(traits.shape[1], np.float32)
    while True:
        k = take_ticket(counter)
        if k >= asked.shape[0]:
            return
        distance[:] = 0
        for trait in range(traits.shape[0]):
            own, others = asked[k, trait], traits[trait]
            for s in range(len(distance)):
                distance[s] += (others[s] - own) * (others[s] - own)
        farthest = distance.min() + np.float32(FARTHEST)
        for s in range(len(distance)):
            if distance[s] < farthest:
                weight = np.float32(math.exp(np.float32(-0.5) * distance[s]))
                for word in range(sums.shape[1]):
                    votes[k, word] += weight * sums[s, word]


def region_votes(asked: Tensor, traits: Tensor, sums: Tensor) -> Tensor:
    """Σ_s exp(−‖asked_k − traits_s‖² / 2) sums_s of K regions, float32 [K, words]; `asked` [K, 6], `traits` [S, 6], `sums` [S, words]."""
    votes = torch.zeros(len(asked), sums.shape[1])
    run_kernel(_votes, asked.contiguous().numpy(), traits.T.contiguous().numpy(), sums.contiguous().numpy(), votes.numpy())
    return votes
