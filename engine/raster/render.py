"""The one function that draws, and what it returns.

Optimisers make numbers without meaning, so these are no errors, whatever the back end:

- NaN or infinity (or a length above 1.8e19) in anything of a Gaussian, features included: it is not drawn, its gradients are zero.
- Quaternions shorter than 1e-12 are the identity, with zero gradient.
- Scales may be zero (a dot of about half a pixel); above 1e4 they count as 1e4, with zero gradient. Their sign is without meaning.
- Opacities are clamped to [0, 1], with zero gradient outside; under 1/255 nothing is drawn.
- Centres with camera z < 0.01 or > 1e10 (units of the means) are not drawn.
- N may be 0; pictures may be 1 × 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from degense.engine.camera import Camera
from degense.engine.raster.cuda import rasterize_cuda
from degense.engine.raster.vjp import vjp
from degense.engine.splats import Splats


def _on_cpu(*arguments: Any, clean: bool) -> tuple[Tensor, Tensor, Tensor]:
    from degense.engine.raster.cpu import rasterize_cpu

    return rasterize_cpu(*arguments)


#: What draws on each kind of device. The benchmarks add a "reference" in float64.
BACKENDS: dict[str, Callable[..., tuple[Tensor, Tensor, Tensor]]] = {"cpu": _on_cpu, "cuda": rasterize_cuda}


@dataclass
class Render:
    """One picture."""

    image: Tensor  # float32 [H, W, C]: blended features, plus what is left of the background
    alpha: Tensor  # float32 [H, W]: coverage in [0, 1]; the image is not divided by it
    radii: Tensor  # int32 [N]: half of the longer side of the box that a Gaussian is drawn in, pixels; 0 where it is not drawn


def rasterize(
    splats: Splats,
    features: Tensor,
    camera: Camera,
    *,
    background: Tensor | None = None,
    screen_offsets: Tensor | None = None,
    backend: str = "auto",
    clean: bool = False,
) -> Render:
    """Draw N Gaussians, nearest first, with C channels of features in place of their own colours and latents.

    C = Σᵢ cᵢ αᵢ Tᵢ + T_end background, Tᵢ = Π_{j<i} (1 − αⱼ), α = min(0.999, o exp(−½ dᵀ Σ'⁻¹ d)), Σ' = J W Σ Wᵀ Jᵀ + 0.3 I (pixels²),
    as in gsplat 1.5.3's classic mode: α below 1/255 is skipped, a pixel is finished before T would fall to 1e-4.
    Differentiable (once) in everything but the camera; work for inputs that need no gradient is skipped. Any number of threads may
    draw at once. What becomes of numbers that are not finite or out of range is said at the head of this file.

    ValueError for wrong shapes, types or devices.

    Parameters
    ----------
    splats : Splats
        Means, quaternions, scales and opacities are read. Scales have the unit of the means.
    features : float [N, C]
        Any C ≥ 1, for example `splats.colors`; all channels are blended in one pass.
    background : float [C] or None
        Seen where light is left. None is zero.
    screen_offsets : float [N, 2] or None
        Added to the projected centres, pixels; zeros that require a gradient tell how the loss pulls on them.
        (CUDA decides before adding them whether a Gaussian is outside the picture.)
    backend : str
        One of `BACKENDS`, or "auto", which follows the tensors' device.
    clean : bool
        The caller knows that every number is finite, opacities lie in [0, 1], scales under 1e4 and no quaternion is zero (a baked state):
        CUDA then skips looking for them, which costs a third of a small picture.

    Returns
    -------
    Render
        float32 whatever the inputs' type: half precision and float64 are computed in float32, and gradients come back in the
        inputs' own type.
    """
    _check(splats, features, camera, background, screen_offsets)
    means = splats.means
    if backend == "auto":
        backend = means.device.type
    if backend not in BACKENDS:
        raise ValueError(f"backend is {backend!r}; use one of 'auto', {', '.join(map(repr, BACKENDS))}")
    if (backend == "cuda") != means.is_cuda:
        raise ValueError(f"back end {backend!r} cannot draw tensors on {means.device}; move them, or use backend='auto'")
    return Render(*BACKENDS[backend](splats, features, camera, background, screen_offsets, clean=clean))


def _check(splats: Splats, features: Tensor, camera: Camera, background: Tensor | None, screen_offsets: Tensor | None) -> None:
    """ValueError unless shapes, types and devices fit together."""
    means = splats.means
    if means.ndim != 2 or features.ndim != 2 or features.shape[1] < 1:
        shapes = f"{list(means.shape)} and {list(features.shape)}"
        raise ValueError(f"means must have shape [N, 3] and features [N, C] with C ≥ 1, but they have {shapes}")
    count, channels = means.shape[0], features.shape[1]
    expected: dict[str, tuple[Tensor | None, tuple[int, ...]]] = {
        "means": (means, (count, 3)),
        "quats": (splats.quats, (count, 4)),
        "scales": (splats.scales, (count, 3)),
        "opacities": (splats.opacities, (count,)),
        "features": (features, (count, channels)),
        "background": (background, (channels,)),
        "screen_offsets": (screen_offsets, (count, 2)),
    }
    for name, (tensor, shape) in expected.items():
        if tensor is None:
            continue
        if tensor.shape != shape:
            raise ValueError(f"{name} must have shape {list(shape)} to fit the others, but has {list(tensor.shape)}")
        if not tensor.is_floating_point():
            raise ValueError(f"{name} must hold floating-point numbers, but holds {tensor.dtype}")
        if tensor.device != means.device:
            raise ValueError(f"{name} is on {tensor.device} but means is on {means.device}; move them to one device")
    if camera.width < 1 or camera.height < 1:
        raise ValueError(f"the camera must see at least 1 × 1 pixels, but has {camera.width} × {camera.height}")
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    if not (np.isfinite(numbers).all() and camera.fx > 0 and camera.fy > 0 and np.isfinite(camera.viewmat).all()):
        raise ValueError("the camera's focal lengths must be positive and its numbers finite")


class BackProjection(NamedTuple):
    """Sums over the pixels p of a picture for each Gaussian i, with blending weights w_ip = α_ip T_ip and confidences m_p."""

    total: Float[Tensor, "n c"]  # Σ_p m_p w_ip v_p
    weight: Float[Tensor, " n"]  # Σ_p m_p w_ip


def backproject(
    splats: Splats,
    values: Float[Tensor, "height width c"],
    camera: Camera,
    *,
    confidence: Float[Tensor, "height width"] | None = None,
    backend: str = "auto",
    clean: bool = False,
) -> BackProjection:
    """Sum values v_p of pixels onto Gaussians, each by its share of the pixel; a `confidence` of None (m_p ≥ 0) counts every pixel once.

    `rasterize` is linear in the features that it blends, F = W x with W = (w_ip)ᵀ and no background, so this is one backward pass:
    ⟨rasterize(x), v⟩ = ⟨x, backproject(v).total⟩. The weights are one more channel.
    `backend` and `clean` are as for `rasterize`.
    """
    still = splats.detach()
    return transposed(
        lambda features: rasterize(still, features, camera, backend=backend, clean=clean).image, values, confidence, splats.means
    )


def transposed(
    draw: Callable[[Tensor], Tensor], values: Float[Tensor, "height width c"], confidence: Tensor | None, means: Tensor
) -> BackProjection:
    """`backproject` by the transpose of `draw`, which blends features [N, C] of the Gaussians at `means` [N, 3]."""
    wanted = pad(values, (0, 1), value=1.0)
    if confidence is not None:
        wanted = wanted * confidence[..., None]
    features = means.new_zeros(len(means), wanted.shape[2])
    with torch.enable_grad():
        image = draw(features.requires_grad_())
        (sums,) = vjp([image], [features], [wanted.to(image)])
    assert sums is not None
    return BackProjection(sums[:, :-1], sums[:, -1])
