"""The whole field on the CPU where no gradient is wanted: few Gaussians at a time, from planes to branches while they lie in the cache."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numba import njit
from torch import Tensor, nn

from degense.engine.field.branches import Kinematics
from degense.engine.field.hexplane import HexPlane, inside
from degense.engine.field.hexplane_cpu import sample_rows
from degense.engine.threads import run_kernel, take_ticket

ROWS = 64  # Gaussians a ticket stands for. BLAS leaves a product of 64 × 64 × 64 to the calling thread; a larger one it would share out


class Level(NamedTuple):
    """A level of a HexPlane at one time."""

    space: np.ndarray
    line: np.ndarray

    @staticmethod
    def of(planes: HexPlane, t: float | Tensor) -> tuple[Level, ...]:
        levels = zip(planes.space, planes.lines(t), strict=True)
        return tuple(Level(space.detach().numpy(), line.detach().contiguous().numpy()) for space, line in levels)


#: Stands for planes that are not there.
NO_LEVEL = Level(np.empty((3, 2, 2, 0), np.float32), np.empty((3, 2, 0), np.float32))


@njit(cache=True, nogil=True)
def _sample(points, levels, out):
    first = 0
    for space, line in levels:
        sample_rows(points, space, line, out, first)
        first += space.shape[3]


@njit(cache=True, nogil=True)
def _channels(levels):
    channels = 0
    for space, _ in levels:
        channels += space.shape[3]
    return channels


@njit(cache=True, nogil=True)
def finish_layer(rows, bias, rectified):
    """rows + bias, or relu of it, in place."""
    for n in range(rows.shape[0]):
        for c in range(rows.shape[1]):
            value = rows[n, c] + bias[c]
            rows[n, c] = max(value, np.float32(0)) if rectified else value


@njit(cache=True, nogil=True)
def _decode(
    points, levels, semantic_levels, linear, entry, trunk, biases, hidden, from_semantic, hidden_biases, last, last_biases, outs, counter
):
    """Weights are [inputs, outputs]; those of `trunk`, behind the `entry`, and of the decoders are stacked, like `outs` [decoder, N, …].

    `linear`: nothing is rectified behind the last layer of `trunk`.
    """
    wide = entry.shape[1]
    all_features, all_semantic = np.empty((ROWS, _channels(levels)), np.float32), np.empty((ROWS, _channels(semantic_levels)), np.float32)
    activations = np.empty((3, ROWS, wide), np.float32)
    while True:
        begin = take_ticket(counter) * ROWS
        if begin >= points.shape[0]:
            return
        end = min(begin + ROWS, points.shape[0])
        features, semantic = all_features[: end - begin], all_semantic[: end - begin]
        current, following, semantic_part = activations[0, : end - begin], activations[1, : end - begin], activations[2, : end - begin]
        _sample(points[begin:end], levels, features)
        if semantic.shape[1]:
            _sample(points[begin:end], semantic_levels, semantic)
        np.dot(features, entry, current)
        finish_layer(current, biases[0], True)
        for layer in range(trunk.shape[0]):
            np.dot(current, trunk[layer], following)
            finish_layer(following, biases[layer + 1], not linear or layer + 1 < trunk.shape[0])
            current, following = following, current
        for decoder in range(hidden.shape[0]):
            np.dot(current, hidden[decoder], following)
            if from_semantic[decoder].any():
                np.dot(semantic, from_semantic[decoder], semantic_part)
                following += semantic_part
            finish_layer(following, hidden_biases[decoder], True)
            np.dot(following, last[decoder], outs[decoder, begin:end])
            finish_layer(outs[decoder, begin:end], last_biases[decoder], False)


def decode(
    points: Tensor,
    t: float | Tensor,
    planes: HexPlane,
    semantic_planes: HexPlane | None,
    kinematics: Kinematics,
    decoders: Sequence[nn.Sequential],
) -> list[Tensor]:
    """Outputs of each of the decoders for `points` [N, 3] (clamped to [-1, 1]) at time `t`, float32 [N, its outputs].

    The fused twin of sampling `planes`, calling `kinematics`, then each decoder, on Z_kin and, where it has more inputs, on features of
    the `semantic_planes` behind it. All hidden layers of `kinematics` and decoders are equally wide.
    """
    entry, *trunk = (layer for layer in (*kinematics.base, kinematics.states) if isinstance(layer, nn.Linear))
    layers = [layer for decoder in decoders for layer in decoder if isinstance(layer, nn.Linear)]
    hidden, last = layers[::2], layers[1::2]
    latent = kinematics.dimension
    levels = Level.of(planes, t)
    semantic_levels = (NO_LEVEL,) * len(levels) if semantic_planes is None else Level.of(semantic_planes, t)
    widths = [layer.out_features for layer in last]
    outs = torch.empty(len(decoders), len(points), max(widths))
    arrays = (
        inside(points).contiguous(),
        entry.weight.detach().T.contiguous(),
        _stacked([layer.weight.T for layer in trunk]),
        _stacked([entry.bias, *(layer.bias for layer in trunk)]),
        _stacked([layer.weight[:, :latent].T for layer in hidden]),
        _stacked([layer.weight[:, latent:].T for layer in hidden]),
        _stacked([layer.bias for layer in hidden]),
        _stacked([layer.weight.T for layer in last]),
        _stacked([layer.bias for layer in last]),
        outs,
    )
    place, *weights = (array.numpy() for array in arrays)
    run_kernel(_decode, place, levels, semantic_levels, kinematics.linear, *weights)
    return [out[:, :width] for out, width in zip(outs, widths, strict=True)]


def _stacked(parts: Sequence[Tensor]) -> Tensor:
    """Vectors or matrices in one array, each with zeros behind it up to the largest."""
    stacked = torch.zeros(len(parts), *(max(sizes) for sizes in zip(*(part.shape for part in parts), strict=True)))
    for place, part in zip(stacked, parts, strict=True):
        place[tuple(slice(size) for size in part.shape)] = part.detach()
    return stacked
