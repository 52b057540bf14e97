"""The transpose of the rasterizer: values of pixels onto the Gaussians that are seen there."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from degense.engine.camera import Camera
from degense.engine.raster.render import rasterize
from degense.engine.splats import Splats


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
    wanted = pad(values, (0, 1), value=1.0)
    if confidence is not None:
        wanted = wanted * confidence[..., None]
    features = splats.means.new_zeros(len(splats), wanted.shape[2])
    with torch.enable_grad():
        image = rasterize(splats.detach(), features.requires_grad_(), camera, backend=backend, clean=clean).image
    (sums,) = torch.autograd.grad(image, features, wanted.to(image))
    return BackProjection(sums[:, :-1], sums[:, -1])
