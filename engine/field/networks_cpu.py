"""The networks of the field on the CPU where gradients are wanted: few rows at a time, forwards and backwards while they lie in the cache.

Rows are shared out in stretches that do not depend on the number of threads; each has sums of its own for the gradients of the weights,
which are added up in order, so that the result does not depend on it either.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numba import njit
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn.functional import pad

from degense.engine.field.branches import Kinematics
from degense.engine.field.decode_cpu import ROWS, finish_layer
from degense.engine.threads import run_kernel, take_ticket

STRETCH = 16 * ROWS  # rows that a ticket stands for backwards


@njit(cache=True, nogil=True)
def _forward(features, rows, linear, entry, trunk, biases, hidden, hidden_biases, last, last_biases, latents, inner, outs, counter):
    """`latents` [layers, R, W] and `inner` [decoders, R, W] get what the layers say after rectification; decoder d reads `rows`[d] rows.

    Without `hidden` layers, [0, W, W], decoders read the latents themselves.
    """
    while True:
        begin = take_ticket(counter) * ROWS
        if begin >= features.shape[0]:
            return
        end = min(begin + ROWS, features.shape[0])
        np.dot(features[begin:end], entry, latents[0, begin:end])
        finish_layer(latents[0, begin:end], biases[0], True)
        for layer in range(trunk.shape[0]):
            np.dot(latents[layer, begin:end], trunk[layer], latents[layer + 1, begin:end])
            finish_layer(latents[layer + 1, begin:end], biases[layer + 1], not linear or layer + 1 < trunk.shape[0])
        for decoder in range(last.shape[0]):
            stop = min(end, rows[decoder])
            if begin < stop:
                read = latents[trunk.shape[0], begin:stop]
                if hidden.shape[0]:
                    np.dot(read, hidden[decoder], inner[decoder, begin:stop])
                    read = inner[decoder, begin:stop]
                    finish_layer(read, hidden_biases[decoder], True)
                np.dot(read, last[decoder], outs[decoder, begin:stop])
                finish_layer(outs[decoder, begin:stop], last_biases[decoder], False)


@njit(cache=True, nogil=True)
def _rectify(grads, values):
    """Gradients behind a rectified layer, in place, from those before it and its values."""
    for n in range(grads.shape[0]):
        for c in range(grads.shape[1]):
            grads[n, c] = grads[n, c] if values[n, c] > np.float32(0) else np.float32(0)


@njit(cache=True, nogil=True)
def _add(sums, rows):
    """sums += rows, in place."""
    for n in range(rows.shape[0]):
        for c in range(rows.shape[1]):
            sums[n, c] += rows[n, c]


@njit(cache=True, nogil=True)
def _add_layer(inputs, grads, product, grad_weight, grad_bias):
    """Add what some rows tell of the weight [inputs, outputs] and bias of a layer; `product` is room for a weight."""
    np.dot(inputs.T, grads, product)
    _add(grad_weight, product)
    for n in range(grads.shape[0]):
        for c in range(grads.shape[1]):
            grad_bias[c] += grads[n, c]


@njit(cache=True, nogil=True)
def _backward(
    features, rows, linear, entry, trunk, hidden, last, latents, inner, grad_outs, grad_features, grad_entry, grad_trunk, grad_biases,
    grad_hidden, grad_hidden_biases, grad_last, grad_last_biases, counter,
):  # fmt: skip
    """Fill `grad_features` [R, F] and, by stretch, the sums of weights and biases. The weights are transposed: [outputs, inputs]."""
    count, depth, wide = features.shape[0], trunk.shape[0], entry.shape[0]
    square, narrow = np.empty((wide, wide), np.float32), np.empty(grad_last.shape[2:], np.float32)
    flat = np.empty(entry.T.shape, np.float32)
    room = np.empty((3, ROWS, wide), np.float32)
    while True:
        stretch = take_ticket(counter)
        if stretch * STRETCH >= count:
            return
        for begin in range(stretch * STRETCH, min((stretch + 1) * STRETCH, count), ROWS):
            end = min(begin + ROWS, count)
            above, below = room[0, : end - begin], room[1, : end - begin]
            above[:] = np.float32(0)
            for decoder in range(last.shape[0]):
                stop = min(end, rows[decoder])
                if begin < stop:
                    up, part, latent = grad_outs[decoder, begin:stop], room[2, : stop - begin], latents[depth, begin:stop]
                    values = inner[decoder, begin:stop] if hidden.shape[0] else latent
                    _add_layer(values, up, narrow, grad_last[stretch, decoder], grad_last_biases[stretch, decoder])
                    np.dot(up, last[decoder], part)
                    if hidden.shape[0]:
                        _rectify(part, values)
                        _add_layer(latent, part, square, grad_hidden[stretch, decoder], grad_hidden_biases[stretch, decoder])
                        np.dot(part, hidden[decoder], below[: stop - begin])
                        _add(above, below[: stop - begin])
                    else:
                        _add(above, part)
            if not linear:
                _rectify(above, latents[depth, begin:end])
            for layer in range(depth - 1, -1, -1):
                values = latents[layer, begin:end]
                _add_layer(values, above, square, grad_trunk[stretch, layer], grad_biases[stretch, layer + 1])
                np.dot(above, trunk[layer], below)
                _rectify(below, values)
                above, below = below, above
            _add_layer(features[begin:end], above, flat, grad_entry[stretch], grad_biases[stretch, 0])
            np.dot(above, entry, grad_features[begin:end])


class _Networks(torch.autograd.Function):
    @staticmethod
    def forward(ctx, features, rows, linear, *weights):
        features, entry, hidden, last = features.contiguous(), weights[0], weights[3], weights[5]
        count, wide = len(features), entry.shape[1]
        latents, inner = torch.empty(1 + len(weights[1]), count, wide), torch.empty(len(hidden), count, wide)
        outs = torch.empty(len(last), count, last.shape[2])
        arrays = [tensor.detach().numpy() for tensor in (features, *weights, latents, inner, outs)]
        run_kernel(_forward, arrays[0], rows, linear, *arrays[1:])
        ctx.save_for_backward(features, *weights, latents, inner)
        ctx.rows, ctx.linear = rows, linear
        return tuple(out[:read] for out, read in zip(outs, rows, strict=True))

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):
        features, *weights, latents, inner = ctx.saved_tensors
        entry, trunk, hidden, last = (weights[i].transpose(-1, -2).contiguous().numpy() for i in (0, 1, 3, 5))
        grad_outs = torch.empty(len(last), len(features), last.shape[1])
        for place, grad in zip(grad_outs, grads, strict=True):
            place[: len(grad)] = grad
        stretches = -(-len(features) // STRETCH)
        grad_features, sums = torch.empty_like(features), [torch.zeros(stretches, *weight.shape) for weight in weights]
        arrays = [tensor.numpy() for tensor in (latents, inner, grad_outs, grad_features, *sums)]
        run_kernel(_backward, features.numpy(), ctx.rows, ctx.linear, entry, trunk, hidden, last, *arrays)
        return grad_features, None, None, *(total.sum(0) for total in sums)


def networks(features: Tensor, kinematics: Kinematics, decoders: Sequence[tuple[nn.Sequential, int]]) -> list[Tensor]:
    """What each of the decoders says of Z_kin of the first so many of the `features`, float32 [R, h_st]: [rows, its outputs].

    The fused twin of calling `kinematics` and then each decoder. All hidden layers are equally wide.
    """
    entry, *trunk = (layer for layer in (*kinematics.base, kinematics.states) if isinstance(layer, nn.Linear))
    hidden, last = zip(*([layer for layer in decoder if isinstance(layer, nn.Linear)] for decoder, _ in decoders), strict=True)
    most = max(layer.out_features for layer in last)
    weights = (
        entry.weight.T.contiguous(),
        torch.stack([layer.weight.T for layer in trunk]),
        torch.stack([layer.bias for layer in (entry, *trunk)]),
        torch.stack([layer.weight.T for layer in hidden]),
        torch.stack([layer.bias for layer in hidden]),
        torch.stack([pad(layer.weight.T, (0, most - layer.out_features)) for layer in last]),
        torch.stack([pad(layer.bias, (0, most - layer.out_features)) for layer in last]),
    )
    outs = _Networks.apply(features, np.array([rows for _, rows in decoders]), kinematics.linear, *weights)
    return [out[:, : layer.out_features] for out, layer in zip(outs, last, strict=True)]


def branch(inputs: Tensor, decode: nn.Sequential) -> Tensor:
    """What a `Branch` says of its inputs, float32 [R, inputs]: the fused twin of calling it."""
    hidden, last = (layer for layer in decode if isinstance(layer, nn.Linear))
    wide = hidden.out_features
    none = inputs.new_empty(0, wide, wide), inputs.new_empty(0, wide)
    weights = (hidden.weight.T.contiguous(), none[0], hidden.bias[None], *none, last.weight.T[None].contiguous(), last.bias[None])
    return _Networks.apply(inputs, np.array([len(inputs)]), False, *weights)[0]
