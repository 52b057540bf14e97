"""Adam (Kingma & Ba, ICLR 2015), on a GPU all of it as one CUDA graph.

`torch.optim.Adam` does the same arithmetic. Making one imports torch's compiler, which takes about as long as torch itself, and its step
starts one kernel after the other that each leave most of a GPU idle.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.optim.adam import adam

from degense.engine.field.cuda_graphs import capture
from degense.engine.latest import Latest

MOMENTS = ("step", "exp_avg", "exp_avg_sq")
BETAS, EPSILON = (0.9, 0.999), 1e-15
GRAPHS = 4  # kept: not all steps have the same regularizers


@dataclass
class _Recorded:
    """A step that may come again."""

    held: list[Tensor]  # its parameters and gradients, so that no others get their identity
    seen: int = 0
    graph: torch.cuda.CUDAGraph | None = None


class Adam:
    """Adam of several groups of parameters, each a dict of its `params`, its rate `lr` and whatever else its owner notes there.

    With `decay` parameters also shrink by so much of their rate a step (AdamW; Loshchilov & Hutter, ICLR 2019). Parameters of a group lie
    on one device; those without a gradient stay as they are. `state` holds the `MOMENTS` of each parameter that has made a step.

    On a GPU the second step with the same gradients, in the same memory, makes the graph that later ones replay: the owner of CUDA graphs
    that hand out such gradients calls `forget` before it gives their memory back.
    """

    def __init__(self, groups: Iterable[dict[str, Any]], *, decay: float = 0.0):
        self.param_groups = [{**group, "params": list(group["params"])} for group in groups]
        self.state: dict[Tensor, dict[str, Tensor]] = {}
        self.decay = decay
        self._rates: Tensor | None = None  # float [groups] on the GPU, which the graph reads
        self._recorded = Latest(GRAPHS)  # by the parameters and gradients of a step, which it holds

    def zero_grad(self) -> None:
        """Forget all gradients."""
        for group in self.param_groups:
            for parameter in group["params"]:
                parameter.grad = None

    def forget(self) -> None:
        """Make graphs anew."""
        self._recorded = Latest(GRAPHS)

    @torch.no_grad()
    def step(self) -> None:
        """One update of every parameter that has a gradient."""
        learning = [[parameter for parameter in group["params"] if parameter.grad is not None] for group in self.param_groups]
        rates: Sequence[float | Tensor] = [group["lr"] for group in self.param_groups]
        first = next((parameter for group in learning for parameter in group), None)
        if first is None:
            return
        if not first.is_cuda:
            for group, rate in zip(learning, rates, strict=True):
                self._update(group, rate)
            return
        if self._rates is None:
            self._rates = torch.zeros(len(rates), device=first.device)
        self._rates.copy_(torch.tensor(rates))
        held = [tensor for group in learning for parameter in group for tensor in (parameter, parameter.grad)]
        step = self._recorded.get(tuple(map(id, held)), lambda: _Recorded(held))
        step.seen += 1
        if step.seen == 1:
            for group, rate in zip(learning, self._rates, strict=True):
                self._update(group, rate)
            return
        if step.graph is None:
            step.graph, _ = capture(lambda: self._side_by_side(learning))
        step.graph.replay()

    def _side_by_side(self, learning: Sequence[Sequence[Tensor]]) -> None:
        """The update of all groups at once, a stream each: one group alone is too little work for a GPU."""
        assert self._rates is not None
        here = torch.cuda.current_stream()
        streams = [torch.cuda.Stream() for _ in learning]
        for group, rate, stream in zip(learning, self._rates, streams, strict=True):
            stream.wait_stream(here)
            with torch.cuda.stream(stream):
                self._update(group, rate)
        for stream in streams:
            here.wait_stream(stream)

    def _update(self, parameters: Sequence[Tensor], rate: float | Tensor) -> None:
        """Adam's arithmetic on parameters with one rate, which is a tensor on a GPU."""
        if not parameters:
            return
        if self.decay:
            for parameter in parameters:
                parameter.mul_(1 - rate * self.decay)
        moments = zip(*(self._moments(parameter).values() for parameter in parameters), strict=True)
        steps, means, squares = (list(values) for values in moments)
        gradients = [parameter.grad for parameter in parameters if parameter.grad is not None]
        adam(
            list(parameters),
            gradients,
            means,
            squares,
            [],
            steps,
            fused=True,
            amsgrad=False,
            beta1=BETAS[0],
            beta2=BETAS[1],
            lr=rate,
            weight_decay=0.0,
            eps=EPSILON,
            maximize=False,
        )

    def _moments(self, parameter: Tensor) -> dict[str, Tensor]:
        if parameter not in self.state:
            begin = torch.zeros((), device=parameter.device), torch.zeros_like(parameter), torch.zeros_like(parameter)
            self.state[parameter] = dict(zip(MOMENTS, begin, strict=True))
        return self.state[parameter]
