"""The field at any time, ready to be drawn: one CUDA graph where there is a GPU."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from degense.engine.field.cuda_graphs import capture, warm_up
from degense.engine.field.model import SceneModel
from degense.engine.splats import Splats
from degense.engine.threads import one_torch_thread


class LiveField:
    """States of a trained scene, lengths multiplied by `unit`, with numbers that a rasterizer need not check.

    The model must not change as long as this is in use.
    """

    def __init__(self, model: SceneModel, unit: float):
        self.model, self.unit = model, unit
        self._time = torch.zeros((), device=model.bounds.device)
        self._graphs: dict[bool, tuple[torch.cuda.CUDAGraph, Splats]] = {}

    def __call__(self, t: float, *, semantics: bool) -> Splats:
        """All Gaussians at time `t` ∈ [-1, 1], with latents or, sooner, with none. On CUDA the next such call overwrites them."""
        if not self._time.is_cuda:
            return self._evaluate(torch.tensor(t), semantics)
        if semantics not in self._graphs:
            warm_up(lambda: self._evaluate(self._time, semantics))
            self._graphs[semantics] = capture(lambda: self._evaluate(self._time, semantics))
        graph, splats = self._graphs[semantics]
        self._time.fill_(t)
        graph.replay()
        return splats

    @torch.no_grad()
    def _evaluate(self, t: Tensor, semantics: bool) -> Splats:
        with one_torch_thread():
            splats = self.model.at(t, semantics=semantics).splats
            splats = replace(splats, means=splats.means * self.unit, scales=splats.scales * self.unit)
        if splats.means.is_cuda:
            from degense.engine.raster.cuda import cleaned

            splats = cleaned(splats, torch.cat([splats.colors, splats.semantics], 1))
        return splats
