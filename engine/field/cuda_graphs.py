"""CUDA graphs: on a GPU a chain of many small kernels is started as one, forward and backward."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, TypeVar

import torch
from torch import Tensor

from degense.engine.raster.vjp import vjp

Result = TypeVar("Result")


def warm_up(function: Callable[[], Result]) -> Result:
    """Run a function as it must have run before it can be captured: kernels are compiled and work spaces made."""
    side = _side_stream()
    side.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(side):
        result = function()
    torch.cuda.current_stream().wait_stream(side)
    return result


@lru_cache
def _side_stream() -> torch.cuda.Stream:
    """One stream for all: cuBLAS keeps a work space of 32 MB for every stream it ever saw."""
    return torch.cuda.Stream()


def capture(function: Callable[[], Result], pool: Any = None) -> tuple[torch.cuda.CUDAGraph, Result]:
    """The graph of a function that was warmed up, and its result, which every replay overwrites.

    Nothing in it may wait for the GPU or depend on values that Python sees. `pool` is the memory of another graph that never replays at
    the same time.
    """
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph, pool=pool):
        result = function()
    return graph, result


@contextmanager
def tf32_products() -> Iterator[None]:
    """Matrix products run in TF32, whose error of 1e-3 is far below the noise of a training step."""
    precision = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("high")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(precision)


def graphed(
    function: Callable[..., tuple[Tensor, ...]], examples: Sequence[Tensor], parameters: Sequence[Tensor] = ()
) -> Callable[..., tuple[Tensor, ...]]:
    """`function`, as a `CudaGraphFunction` on CUDA; itself on the CPU, where nothing is gained.

    `examples` are arguments of the shapes and types that it will be called with, tensors all; where a gradient is wanted they require one.
    `parameters` are what else it reads that needs a gradient.
    """
    return CudaGraphFunction(function, examples, parameters) if examples[0].device.type == "cuda" else function


class CudaGraphFunction:
    """A function of tensors as two CUDA graphs, one forward and one backward.

    It always works in the same memory: its results, and the gradients it hands out, are overwritten by the next call; those of parameters
    become or join their `grad`, so that calls of one step may share parameters. Matrix products are `tf32_products`.
    No other autograd graph that holds `parameters` may be alive while it is made.
    """

    def __init__(self, function: Callable[..., tuple[Tensor, ...]], examples: Sequence[Tensor], parameters: Sequence[Tensor]):
        self.inputs = [example.detach().clone().requires_grad_(example.requires_grad) for example in examples]
        wanted = [tensor for tensor in (*self.inputs, *parameters) if tensor.requires_grad]
        with tf32_products():
            wanted = warm_up(lambda: self._reached(function, wanted))
            self.forward_graph, results = capture(lambda: function(*self.inputs))
            differentiable = [result for result in results if result.requires_grad]
            # contiguous, as Adam's fused kernel needs them
            self.backward_graph, gradients = capture(
                lambda: [gradient.contiguous() for gradient in vjp(differentiable, wanted, self.incoming) if gradient is not None],
                self.forward_graph.pool(),
            )
        self.outputs = [result.detach() for result in results]
        self.differentiable = [result.requires_grad for result in results]
        gradient_of = {id(tensor): gradient for tensor, gradient in zip(wanted, gradients, strict=True)}
        self.input_gradients = [gradient_of.get(id(tensor)) for tensor in self.inputs]
        self.parameter_gradients = [(tensor, gradient_of[id(tensor)]) for tensor in parameters if id(tensor) in gradient_of]
        # autograd only comes back here if something that it was given needs a gradient
        self.leaf = torch.zeros((), device=self.outputs[0].device, requires_grad=True)

    def _reached(self, function: Callable[..., tuple[Tensor, ...]], wanted: Sequence[Tensor]) -> list[Tensor]:
        """Those of `wanted` that get a gradient, by running forward and backward once; makes the memory of incoming gradients."""
        outputs = [output for output in function(*self.inputs) if output.requires_grad]
        self.incoming = [torch.zeros_like(output) for output in outputs]
        gradients = vjp(outputs, wanted, self.incoming)
        return [tensor for tensor, gradient in zip(wanted, gradients, strict=True) if gradient is not None]

    def __call__(self, *arguments: Tensor) -> tuple[Tensor, ...]:
        return _Replay.apply(self, self.leaf, *arguments)


class _Replay(torch.autograd.Function):
    @staticmethod
    def forward(ctx, graphs, _, *arguments):
        ctx.graphs = graphs
        ctx.set_materialize_grads(False)
        for held, given in zip(graphs.inputs, arguments, strict=True):
            held.copy_(given)
        graphs.forward_graph.replay()
        outputs = tuple(output.detach() for output in graphs.outputs)
        ctx.mark_non_differentiable(*(o for o, differentiable in zip(outputs, graphs.differentiable, strict=True) if not differentiable))
        return outputs

    @staticmethod
    def backward(ctx, *gradients):
        graphs = ctx.graphs
        arriving = (gradient for gradient, differentiable in zip(gradients, graphs.differentiable, strict=True) if differentiable)
        for held, given in zip(graphs.incoming, arriving, strict=True):
            if given is None:
                held.zero_()
            else:
                held.copy_(given)
        graphs.backward_graph.replay()
        for parameter, gradient in graphs.parameter_gradients:  # handed over without the copy that autograd would make of each
            if parameter.grad is None:
                parameter.grad = gradient
            else:
                parameter.grad.add_(gradient)
        return None, None, *graphs.input_gradients
