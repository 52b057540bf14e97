"""How far the model says that tissue moved, and how much of that contradicts the images."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor


def displacement(means_t: Float[Tensor, "n 3"], means_ref: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """Distance of every Gaussian from its place at the reference time, ‖μᵢ(t) − μᵢ(ref)‖, scene units."""
    return torch.linalg.vector_norm(means_t - means_ref, dim=-1)


def spurious(
    model_flow: Float[np.ndarray, "height width 2"],
    observed_flow: Float[np.ndarray, "height width 2"],
    reliable: Bool[np.ndarray, "height width"],
    tolerance: float = 1.0,
) -> Float32[np.ndarray, "height width"]:
    """Model motion that the images contradict: max(0, ‖m(p) − o(p)‖ − tolerance), pixels.

    m is the model's motion projected into the image (`Scene.render`: `motion`), o the observed optical flow between the same two frames
    in the same direction. Where flow is not reliable (hidden, tools, out of the image) the result is NaN: not known,
    which is not the same as 0.

    What it cannot see: motion along the line of sight, which hardly moves pixels (at depth z, a change Δz shifts a pixel r away from
    the principal point by about r · Δz / z); errors below the tolerance, which should be the flow's own error; sliding along plain
    surfaces or straight edges, where flow itself is a guess (`engine.motion.confidence`); and motion that flow invents, for example of
    a highlight or where tissue chars. Missing motion counts like motion too many: both are a difference.

    Flows and tolerance are in pixels. The result is NaN also where either flow is not finite.
    """
    difference = np.linalg.norm(np.asarray(model_flow, np.float32) - np.asarray(observed_flow, np.float32), axis=-1)
    excess = np.maximum(difference - tolerance, 0)  # NaN stays NaN
    return np.where(reliable, excess, np.nan).astype(np.float32)
