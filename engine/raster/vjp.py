"""Vector–Jacobian products: gradients of tensors from the gradients of what was computed of them."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable


class _Pulled(torch.autograd.Function):
    """A zero whose gradient by `outputs` is `pulls`."""

    @staticmethod
    def forward(ctx, pulls, *outputs):
        ctx.pulls = pulls
        return outputs[0].new_zeros(())

    @staticmethod
    @once_differentiable
    def backward(ctx, _):
        return None, *ctx.pulls


def vjp(outputs: Sequence[Tensor], inputs: Sequence[Tensor], pulls: Sequence[Tensor]) -> tuple[Tensor | None, ...]:
    """Σ_k pulls_kᵀ ∂outputs_k / ∂input of each input; None for what no output depends on. `pulls` have the shapes of the outputs.

    As `torch.autograd.grad(outputs, inputs, pulls)`, which imports a compiler and sympy, half a second to three, to compare the shapes.
    """
    return torch.autograd.grad(_Pulled.apply(pulls, *outputs), inputs, allow_unused=True)
