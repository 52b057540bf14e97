"""How Gaussians move, turn and grow: layers of the deformation itself, one number a Gaussian, blended over those of a pixel."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from degense.engine.layers.layer import Layer, LayerRequest
from degense.engine.scene import Scene

Measure = Callable[[Scene, float], Tensor]


def speeds(before: Float[Tensor, "n 3"], after: Float[Tensor, "n 3"], seconds: float) -> Float[Tensor, " n"]:
    """‖μ(t + h) − μ(t − h)‖ / 2h of every Gaussian, [N], scene units a second; `seconds` is 2h. 0 for a sequence of a single instant."""
    return torch.linalg.vector_norm(after - before, dim=-1) / seconds if seconds > 0 else torch.zeros_like(before[:, 0])


def turns(quats: Float[Tensor, "n 4"], reference: Float[Tensor, "n 4"]) -> Float[Tensor, " n"]:
    """Angle of the rotation that leads from the reference to now, 2·atan2(‖Im(q·q̄ᵣ)‖, |Re(q·q̄ᵣ)|), [N], degrees in [0, 180].

    Quaternions wxyz of any non-zero length; q and −q are the same rotation. A Gaussian that is round about an axis looks the same after a
    turn about it, so the images say nothing about that turn.
    """
    here, there = torch.nn.functional.normalize(quats, dim=-1), torch.nn.functional.normalize(reference, dim=-1)
    w, v, a, b = here[:, :1], here[:, 1:], there[:, :1], there[:, 1:]
    imaginary = a * v - w * b - torch.linalg.cross(v, b)  # of q·q̄ᵣ; atan2 is exact for small angles, where acos is not
    real = (here * there).sum(-1).abs()
    return torch.rad2deg(2 * torch.atan2(torch.linalg.vector_norm(imaginary, dim=-1), real))


def growths(scales: Float[Tensor, "n 3"], reference: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """log₂ of the ratio of volumes, Σₖ log₂(sₖ(t) / sₖ(ref)), [N]: 1 has doubled, −1 has halved, 0 is unchanged."""
    return (torch.log2(scales) - torch.log2(reference)).sum(-1)


def speed_of(scene: Scene, frame: float) -> Tensor:
    """Central difference over the two neighbouring frames; one-sided at both ends of the sequence."""
    first, last = max(0.0, frame - 1), min(float(scene.frames - 1), frame + 1)
    return speeds(scene.states.advected_means(first), scene.states.advected_means(last), (last - first) / scene.fps)


def turn_of(scene: Scene, frame: float) -> Tensor:
    return turns(scene.splats(frame).quats, scene.splats(scene.reference_frame).quats)


def growth_of(scene: Scene, frame: float) -> Tensor:
    return growths(scene.splats(frame).scales, scene.splats(scene.reference_frame).scales)


def moving(name: str, description: str, measure: Measure, unit: Callable[[Scene], str], signed: bool = False) -> Layer:
    """A layer of one number a Gaussian. All but the speed are measured from the reference frame."""

    def pixels(scene: Scene, request: LayerRequest) -> np.ndarray:
        return scene.renderer.blend(name, request.frame, lambda: measure(scene, float(request.frame)), request.camera)

    def per_splat(scene: Scene, request: LayerRequest) -> np.ndarray:
        return measure(scene, float(request.frame)).float().cpu().numpy()

    return Layer(
        name,
        "scalar",
        description,
        pixels,
        per_splat,
        unit,
        "vik" if signed else "viridis",
        signed=signed,
        from_zero=not signed,
        of_motion=True,
        guess="hatched: a guess, motion not seen",
        since_reference=measure is not speed_of,
    )


SPEED = moving(
    "speed",
    "How fast tissue moves: ‖μ(t + 1) − μ(t − 1)‖ over the time between the two neighbouring frames, blended over a pixel's Gaussians. "
    "Hatched where the displacement is a guess.",
    speed_of,
    lambda scene: f"{scene.unit}/s",
)
ROTATION = moving(
    "rotation",
    "Angle by which Gaussians have turned since the reference frame: 2·acos|⟨q(t), q(reference)⟩|, blended over the Gaussians of a pixel. "
    "A turn of a round Gaussian cannot be seen. Hatched where the displacement is a guess.",
    turn_of,
    lambda scene: "°",
)
SCALE = moving(
    "scale",
    "How Gaussians have grown or shrunk since the reference frame: log₂ of the ratio of their volumes, Σ log₂(s(t) / s(reference)); "
    "+1 has doubled, −1 has halved. Hatched where the displacement is a guess.",
    growth_of,
    lambda scene: "log₂ volume",
    signed=True,
)
