"""Recorded computation: on a GPU, a chain of many small kernels is started as one CUDA graph, forward and backward."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import torch
from torch import Tensor


def recorded(
    function: Callable[..., tuple[Tensor, ...]], examples: Sequence[Tensor], parameters: Sequence[Tensor] = ()
) -> Callable[..., Any]:
    """`function`, recorded with its gradient on CUDA; itself on the CPU, where nothing is gained.

    Parameters
    ----------
    function : callable
        Of tensors only, to a tuple of tensors. Nothing in it may wait for the GPU or depend on values that Python sees.
    examples : sequence of Tensor
        Arguments of the shapes and types that it will be called with; where a gradient is wanted they require one.
    parameters : sequence of Tensor
        What else it reads that needs a gradient.
    """
    return Recording(function, examples, parameters) if examples[0].device.type == "cuda" else function


class Recording:
    """A function of tensors as two CUDA graphs.

    It always works in the same memory: its results, and the gradients it hands out, are overwritten by the next call; those of parameters
    become or join their `grad`, so that calls of one step may share parameters. Matrix products run in TF32, whose error of 1e-3 is far
    below the noise of a training step.
    No other autograd graph that holds `parameters` may be alive while it is made.
    """

    def __init__(self, function: Callable[..., tuple[Tensor, ...]], examples: Sequence[Tensor], parameters: Sequence[Tensor]):
        self.inputs = [example.detach().clone().requires_grad_(example.requires_grad) for example in examples]
        wanted = [tensor for tensor in (*self.inputs, *parameters) if tensor.requires_grad]
        precision = torch.get_float32_matmul_precision()
        torch.set_float32_matmul_precision("high")
        try:
            side = _warming_stream()
            side.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(side):  # kernels are compiled and work spaces made before the recording
                outputs = [output for output in function(*self.inputs) if output.requires_grad]
                self.incoming = [torch.zeros_like(output) for output in outputs]
                reached = torch.autograd.grad(outputs, wanted, self.incoming, allow_unused=True)
                wanted = [tensor for tensor, gradient in zip(wanted, reached, strict=True) if gradient is not None]
                del outputs, reached
            torch.cuda.current_stream().wait_stream(side)
            self.forward_graph, self.backward_graph = torch.cuda.CUDAGraph(), torch.cuda.CUDAGraph()
            with torch.cuda.graph(self.forward_graph):
                results = function(*self.inputs)
            with torch.cuda.graph(self.backward_graph, pool=self.forward_graph.pool()):
                reached = torch.autograd.grad([result for result in results if result.requires_grad], wanted, self.incoming)
                gradients = [gradient.contiguous() for gradient in reached]  # as Adam's fused kernel needs them
        finally:
            torch.set_float32_matmul_precision(precision)
        self.outputs = [result.detach() for result in results]
        self.differentiable = [result.requires_grad for result in results]
        reached_by = {id(tensor): gradient for tensor, gradient in zip(wanted, gradients, strict=True)}
        self.input_gradients = [reached_by.get(id(tensor)) for tensor in self.inputs]
        self.parameter_gradients = [(tensor, reached_by[id(tensor)]) for tensor in parameters if id(tensor) in reached_by]
        # autograd only comes back here if something that it was given needs a gradient
        self.leaf = torch.zeros((), device=self.outputs[0].device, requires_grad=True)

    def __call__(self, *arguments: Tensor) -> tuple[Tensor, ...]:
        return _Replay.apply(self, self.leaf, *arguments)


@lru_cache
def _warming_stream() -> torch.cuda.Stream:
    """The one stream on which functions run before they are recorded: cuBLAS keeps a work space of 32 MB for every stream it ever saw."""
    return torch.cuda.Stream()


class _Replay(torch.autograd.Function):
    @staticmethod
    def forward(ctx, recording, _, *arguments):
        ctx.recording = recording
        ctx.set_materialize_grads(False)
        for kept, given in zip(recording.inputs, arguments, strict=True):
            kept.copy_(given)
        recording.forward_graph.replay()
        outputs = tuple(output.detach() for output in recording.outputs)
        ctx.mark_non_differentiable(*(o for o, differentiable in zip(outputs, recording.differentiable, strict=True) if not differentiable))
        return outputs

    @staticmethod
    def backward(ctx, *gradients):
        recording = ctx.recording
        arriving = (gradient for gradient, differentiable in zip(gradients, recording.differentiable, strict=True) if differentiable)
        for kept, given in zip(recording.incoming, arriving, strict=True):
            if given is None:
                kept.zero_()
            else:
                kept.copy_(given)
        recording.backward_graph.replay()
        for parameter, gradient in recording.parameter_gradients:  # handed over without the copy that autograd would make of each
            if parameter.grad is None:
                parameter.grad = gradient
            else:
                parameter.grad.add_(gradient)
        return None, None, *recording.input_gradients
