"""The whole field on the CPU where no gradient is wanted: few Gaussians at a time, from planes to branches while they lie in the cache."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numba import njit
from torch import Tensor, nn

from engine.field.hexplane import HexPlane, inside
from engine.field.hexplane_cpu import sample_rows
from engine.field.kinematics import Kinematics
from engine.threads import run_kernel, take_ticket

ROWS = 64  # Gaussians a ticket stands for. BLAS leaves a product of 64 × 64 × 64 to the calling thread; a larger one it would share out


class Layer(NamedTuple):
    """x W + b, with W [inputs, outputs] in C order."""

    weight: np.ndarray
    bias: np.ndarray

    @staticmethod
    def of(linear: nn.Linear, inputs: slice = slice(None)) -> Layer:
        """From torch's layer, or the part of it that reads some of its inputs."""
        return Layer(linear.weight.detach()[:, inputs].T.contiguous().numpy(), linear.bias.detach().numpy())


class Head(NamedTuple):
    """A decoder: W_last relu(W_hidden Z_kin + W_own h_own + b) + b_last, with no rows in W_own where it reads Z_kin alone."""

    hidden: Layer
    own: np.ndarray
    last: Layer

    @staticmethod
    def of(decoder: nn.Sequential, latent: int) -> Head:
        """From `engine.field.branches.decoder`, of whose inputs the first `latent` are Z_kin."""
        hidden, _, last = decoder
        assert isinstance(hidden, nn.Linear)
        assert isinstance(last, nn.Linear)
        return Head(Layer.of(hidden, slice(latent)), Layer.of(hidden, slice(latent, None)).weight, Layer.of(last))


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
def _add(rows, bias, rectified):
    """rows + bias, or relu of it, in place."""
    for n in range(rows.shape[0]):
        for c in range(rows.shape[1]):
            value = rows[n, c] + bias[c]
            rows[n, c] = max(value, np.float32(0)) if rectified else value


@njit(cache=True, nogil=True)
def _decode(points, levels, own_levels, trunk, heads, outs, counter):
    wide = trunk[0][1].shape[0]
    feature, own = np.empty((ROWS, _channels(levels)), np.float32), np.empty((ROWS, _channels(own_levels)), np.float32)
    one, two, more = np.empty((ROWS, wide), np.float32), np.empty((ROWS, wide), np.float32), np.empty((ROWS, wide), np.float32)
    while True:
        begin = take_ticket(counter) * ROWS
        if begin >= points.shape[0]:
            return
        end = min(begin + ROWS, points.shape[0])
        rows = end - begin
        _sample(points[begin:end], levels, feature)
        np.dot(feature[:rows], trunk[0][0], one[:rows])
        _add(one[:rows], trunk[0][1], True)
        np.dot(one[:rows], trunk[1][0], two[:rows])
        _add(two[:rows], trunk[1][1], True)
        np.dot(two[:rows], trunk[2][0], one[:rows])
        _add(one[:rows], trunk[2][1], True)
        if own.shape[1]:
            _sample(points[begin:end], own_levels, own)
        for index in range(len(heads)):
            hidden, of_own, last = heads[index]
            np.dot(one[:rows], hidden[0], two[:rows])
            if of_own.shape[0]:
                np.dot(own[:rows], of_own, more[:rows])
                two += more
            _add(two[:rows], hidden[1], True)
            np.dot(two[:rows], last[0], outs[index][begin:end])
            _add(outs[index][begin:end], last[1], False)


def decode(
    points: Tensor, t: float | Tensor, planes: HexPlane, own: HexPlane | None, kinematics: Kinematics, decoders: Sequence[nn.Sequential]
) -> list[Tensor]:
    """What each of the decoders says at time `t`, float32 [N, its outputs].

    The fused twin of sampling `planes`, calling `kinematics`, then each decoder, on Z_kin and, where it has more inputs, on features of
    planes of its `own` behind it.

    Parameters
    ----------
    points : float32 [N, 3]
        Clamped to [-1, 1].
    kinematics, decoders
        All their hidden layers are equally wide.
    """
    trunk = tuple(Layer.of(layer) for layer in (*kinematics.base, kinematics.states) if isinstance(layer, nn.Linear))
    heads = tuple(Head.of(decoder, kinematics.dimension) for decoder in decoders)
    levels, own_levels = Level.of(planes, t), (NO_LEVEL,) if own is None else Level.of(own, t)
    outs = [torch.empty(len(points), len(head.last.bias)) for head in heads]
    run_kernel(_decode, inside(points).contiguous().numpy(), levels, own_levels, trunk, heads, tuple(out.numpy() for out in outs))
    return outs
