"""A training step on a GPU as one CUDA graph: field, drawing, losses, all of it backwards, and what is noted of the step.

In parts, each a graph, a step of `balanced` leaves the GPU idle for a third of the time: the processor takes longer to start the parts than
the GPU to run them, and gsplat waits for how many Gaussians its tiles show.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.field import SceneModel
from degense.engine.field.cuda_graphs import capture, tf32_products, warm_up
from degense.engine.raster.camera_tensors import intrinsic_matrix, view_matrix
from degense.engine.raster.cuda import rasterize_in_graph
from degense.engine.raster.vjp import vjp
from degense.engine.training.density import Density
from degense.engine.training.frames import Frame
from degense.engine.training.loss_terms import Loss, LossSums
from degense.engine.training.passes import FieldState, Passes

ROOM = 3  # times the entries of tiles that the first step needs: another frame, or Gaussians that have grown, need more


@dataclass
class _Recorded:
    """A graph of steps of one kind."""

    inputs: list[Tensor]  # what it reads
    graph: torch.cuda.CUDAGraph
    gradients: list[Tensor | None]  # what it writes, of each parameter


class StepGraph:
    """Steps without semantics. Adam is its owner's.

    Of each kind the first step runs kernel by kernel, the second is recorded, and later ones replay that: all three are steps like others.
    """

    def __init__(self, model: SceneModel, passes: Passes, density: Density, sums: LossSums):
        self.model, self.passes, self.density, self.sums = model, passes, density, sums
        self._one, self._zero = (make((), device=model.bounds.device) for make in (torch.ones, torch.zeros))
        self._needed = torch.zeros((), dtype=torch.int64, device=model.bounds.device)  # most entries of a step's tiles since `forget`
        self._lacked = torch.zeros_like(self._needed)  # the same of the steps for which there was too little room; 0 where there was none
        self._least_room = 0
        self._side = torch.cuda.Stream()
        self.forget()

    def forget(self) -> None:
        """Begin anew: the Gaussians or the stage have changed."""
        self._room = 0
        self._needed.zero_()
        self._begun: set[Hashable] = set()
        self._recorded: dict[Hashable, _Recorded] = {}

    def ran_out_of_room(self, *, finite: bool) -> bool:
        """Whether the tiles of a step since the last question had more entries than there was room for; waits for the GPU.

        If so there is more from now on; not where what was trained is no longer `finite`: what it needed then says nothing.
        """
        needed = int(self._lacked) if finite else 0
        self._lacked.zero_()
        self._least_room = max(self._least_room, ROOM * needed)
        return needed > 0

    def __call__(
        self, camera: Camera, frame: Frame, asked: Sequence[Tensor], flow: Sequence[Tensor], smoothness: Tensor | None, *, observe: bool
    ) -> None:
        """Run a step: gradients become those of the parameters.

        `asked` is what `FieldPass` is asked for, `flow` the `FlowSupervision.inputs` of its pair, empty where it has none, `smoothness` the
        weight of the `SmoothnessPass`, None where the step has none. Density control notes a step with `observe`.
        """
        device, parameters = self._one.device, list(self.model.parameters())
        inputs = [view_matrix(camera, device), intrinsic_matrix(camera, device), frame.image, frame.valid, frame.depth, *asked, *flow]
        kind, here = (len(asked), len(flow), observe), torch.cuda.current_stream()
        for parameter in parameters:
            parameter.grad = None
        if smoothness is not None:  # beside the rest: kernels as small as its leave room
            self._side.wait_stream(here)
            with torch.cuda.stream(self._side):
                loss = Loss(*self.passes("smoothness", smoothness))
                loss.total.backward()
        with tf32_products():
            if kind not in self._begun:
                self._begun.add(kind)
                gradients = warm_up(lambda: self._run(camera, inputs, len(asked), observe, None))
            else:
                gradients = self._replayed(kind, camera, inputs)
        if smoothness is not None:
            here.wait_stream(self._side)
            self.sums.add(loss.total, self._zero, {"smoothness": loss})
        for parameter, gradient in zip(parameters, gradients, strict=True):
            if gradient is not None:
                parameter.grad = gradient if parameter.grad is None else gradient.add_(parameter.grad)

    def _replayed(self, kind: tuple[int, int, bool], camera: Camera, inputs: Sequence[Tensor]) -> list[Tensor | None]:
        """The gradients of a step of a kind that has been begun."""
        if kind not in self._recorded:
            asked, _, observe = kind
            self._room = self._room or max(self._least_room, ROOM * int(self._needed))
            held = [given.clone() for given in inputs]
            self._recorded[kind] = _Recorded(held, *capture(lambda: self._run(camera, held, asked, observe, self._room)))
        recorded = self._recorded[kind]
        for own, given in zip(recorded.inputs, inputs, strict=True):
            own.copy_(given)
        recorded.graph.replay()
        return recorded.gradients

    def _run(self, camera: Camera, inputs: Sequence[Tensor], asked: int, observe: bool, room: int | None) -> list[Tensor | None]:
        """Gradients of all parameters, None of those that have none; of the camera only the size is read."""
        view, lens, image, valid, depth = inputs[:5]
        field = FieldState(*self.passes("field", *inputs[5 : 5 + asked]))
        offsets = torch.zeros(len(field.means), 2, device=view.device, requires_grad=True)
        drawn = rasterize_in_graph(field.splats, field.features, camera, (view, lens), offsets, room)
        losses, squared_error = self.passes.losses(field, drawn, (image, valid, depth), inputs[5 + asked :])
        loss = reduce(add, (part.total for part in losses.values()))
        parameters = list(self.model.parameters())
        learned = [parameter for parameter in parameters if parameter.requires_grad]
        pull, *gradients = vjp([loss], [offsets, *learned], [self._one])
        self.sums.add(loss, squared_error, losses)
        if observe and pull is not None:
            self.density.observe(pull, drawn.radii, field.opacities, camera.width / 2)
        torch.maximum(self._needed, drawn.needed, out=self._needed)
        if room is not None:
            torch.maximum(self._lacked, torch.where(drawn.needed > room, drawn.needed, 0), out=self._lacked)
        # contiguous, as Adam's fused kernel needs them
        found_of = {id(p): g.contiguous() for p, g in zip(learned, gradients, strict=True) if g is not None}
        return [found_of.get(id(parameter)) for parameter in parameters]
