"""Values kept at evenly spaced times, read between them."""

from __future__ import annotations

import torch
from torch import Tensor

#: Numbers a knot, under which a processor is faster with one product over all knots than with picking four of them: a quarter of the time.
SHORT = 16


def at_time(knots: Tensor, t: float | Tensor) -> Tensor:
    """Uniform cubic B-spline along axis 1, whose K knots are spread evenly over [-1, 1]; times outside are clamped.

    Smooth in its second derivative, as tissue moves: a frame that was held out between two others is predicted better than by straight
    lines, which bend at the knots. Beyond the ends the outermost knots are repeated. Constants stay exactly what they are.

    Parameters
    ----------
    knots : float [A, K, ...]
    t : float or float []
        A tensor on the knots' device may change after the call was recorded in a CUDA graph.

    Returns
    -------
    float [A, ...]
    """
    count = knots.shape[1]
    if count == 1:
        return knots.select(1, 0)
    time = torch.as_tensor(t, dtype=knots.dtype, device=knots.device)
    position = ((time + 1) / 2).clamp(0, 1) * (count - 1)
    low = position.floor().clamp(max=count - 2)
    index = (low.long() + _taps(knots.device)).clamp(0, count - 1)
    u = position - low
    v = 1 - u
    weights = torch.stack([v**3, 3 * u**3 - 6 * u**2 + 4, 3 * v**3 - 6 * v**2 + 4, u**3]) / 6
    if knots.device.type == "cpu" and knots.ndim == 3 and knots.shape[2] < SHORT:
        of_knot = weights.new_zeros(count).index_add(0, index, weights)
        return knots.flatten(1) @ torch.kron(of_knot[:, None], torch.eye(knots.shape[2], dtype=knots.dtype))
    return torch.tensordot(knots.index_select(1, index), weights, ([1], [0]))


def _taps(device: torch.device) -> Tensor:
    return torch.arange(-1, 3, device=device)
