"""The groups of Adam, one a kind of parameter, how the rates fall, and the state of a model with its optimiser."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.training.adam import MOMENTS, Adam
from degense.engine.training.config import TrainConfig

MOTION = {"field", "planes"}
DECAYING = {"means", "semantic"} | MOTION
COOLDOWN = 0.3  # last part of a training, in which all learning rates fall
SETTLED = 0.05  # of its rate is left of everything at the end


def make_optimiser(model: SceneModel, config: TrainConfig) -> Adam:
    """Groups: each canonical parameter that is learned (so that densification can swap it), planes, networks, semantic networks."""
    rates = {
        "means": config.rate_means,
        "log_scales": config.rate_scales,
        "quats": config.rate_quats,
        "logits": config.rate_opacity,
        "colors": config.rate_color,
        "color_residuals": config.rate_color_residuals,
        "semantics": config.rate_semantics,
        "velocities": config.rate_means if config.velocities else 0.0,
    }
    groups = [{"name": name, "params": [model.canonical[name]], "lr": rate} for name, rate in rates.items()]
    networks = [model.kinematics, model.geometry, *([model.appearance] if model.appearance is not None else [])]
    semantic = list(model.semantic.parameters()) if model.semantic is not None else []
    planes = list(model.planes.parameters())
    semantic_planes = list(model.semantic_planes.parameters()) if model.semantic_planes is not None else []
    groups.append({"name": "planes", "params": planes + semantic_planes, "lr": config.rate_planes})
    groups.append({"name": "field", "params": [p for network in networks for p in network.parameters()], "lr": config.rate_field})
    if semantic:
        groups.append({"name": "semantic", "params": semantic, "lr": config.rate_field})
    for group in groups:
        group["base"] = group["lr"]
    return Adam(groups)


def set_rates(optimizer: Adam, config: TrainConfig, progress: float, scale: float) -> None:
    """Rates at `progress` (0 … 1), everything times `scale`.

    Positions and field fall exponentially to `rate_final` of their start. In the cool-down all rates fall to `SETTLED` as well, in a
    straight line: Adam's steps are as long as its rate, and a model whose rates stay jitters around what it has learned. The field has gone
    through all this when `motion_iterations` are over, and its rates are 0 from then on.
    """
    for group in optimizer.param_groups:
        done = progress / config.motion_share if group["name"] in MOTION else progress
        decay = config.rate_final**done if group["name"] in DECAYING else 1.0
        settle = 1 - (1 - SETTLED) * max(0.0, done - (1 - COOLDOWN)) / COOLDOWN
        group["lr"] = group["base"] * scale * settle * decay if done <= 1 else 0.0


def learned_state(model: SceneModel, optimizer: Adam) -> dict[str, dict[str, Tensor]]:
    """Copies of the parameters of a model ("model") and of Adam's moments by parameter ("moments")."""
    moments: dict[str, Tensor] = {}
    for name, parameter in model.named_parameters():
        if held := optimizer.state.get(parameter):
            moments |= {f"{name}.{key}": torch.as_tensor(held[key]).detach().clone() for key in MOMENTS}
    return {"model": {name: value.detach().clone() for name, value in model.state_dict().items()}, "moments": moments}


def restore_learned(model: SceneModel, config: TrainConfig, state: Mapping[str, Mapping[str, Tensor]]) -> Adam:
    """Give a model the parameters that `learned_state` copied, however many Gaussians it has; a new optimiser with their moments."""
    device = model.bounds.device
    for name, old in model.canonical.items():
        model.canonical[name] = torch.nn.Parameter(state["model"][f"canonical.{name}"].to(device).clone(), old.requires_grad)
    model.load_state_dict(state["model"])
    optimizer, moments = make_optimiser(model, config), state["moments"]
    for name, parameter in model.named_parameters():
        if f"{name}.exp_avg" in moments:
            optimizer.state[parameter] = {key: moments[f"{name}.{key}"].to(device).clone() for key in MOMENTS}
    return optimizer
