"""Training losses. Maps come back unreduced where a test or a picture may want them."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from degense.engine.training.fused import rigidity_cpu

Scalar = Float[Tensor, ""]
Channels = Float[Tensor, "height width channels"]
Picture = Float[Tensor, "height width 3"]
Plane = Float[Tensor, "height width"]
Latents = Float[Tensor, "pixels d"]

WINDOW, SIGMA = 11, 1.5
TORN = 0.01  # scene units (median depth 1): neighbours that move so differently are drawn to each other with a quarter of the force


class _Blur(torch.autograd.Function):
    """Gaussian window over [H, W, C] with zeros outside. A symmetric window is its own adjoint, so the gradient is blurred the same way."""

    @staticmethod
    def forward(ctx, values):
        return window_mean(values)

    @staticmethod
    def backward(ctx, grad):
        return window_mean(grad)


def window_mean(values: Channels) -> Channels:
    """Weighted mean over the SSIM window. On the CPU by OpenCV: a hundred times as fast as torch's convolution of single channels."""
    if values.device.type == "cpu":
        kernel = window()
        return torch.from_numpy(cv2.sepFilter2D(values.contiguous().numpy(), -1, kernel, kernel, borderType=cv2.BORDER_CONSTANT))
    weights = _window_on(values.device, values.dtype)
    planes = values.permute(2, 0, 1)[:, None]
    planes = F.conv2d(planes, weights.view(1, 1, 1, -1), padding=(0, WINDOW // 2))
    return F.conv2d(planes, weights.view(1, 1, -1, 1), padding=(WINDOW // 2, 0))[:, 0].permute(1, 2, 0)


def window() -> np.ndarray:
    """The window of SSIM along one axis, float64 [WINDOW], sum 1."""
    kernel = np.exp(-np.square(np.arange(WINDOW) - WINDOW // 2) / (2 * SIGMA**2))
    return kernel / kernel.sum()


@lru_cache
def _window_on(device: torch.device, dtype: torch.dtype) -> Tensor:
    return torch.as_tensor(window(), dtype=dtype, device=device)


def ssim_map(image: Channels, target: Channels) -> Channels:
    """Structural similarity per pixel and channel.

    Gaussian window 11 × 11, σ 1.5, zeros outside, C1 = 0.01², C2 = 0.03² for values in [0, 1] (Wang et al. 2004).
    """
    if image.device.type == "cuda" and image.dtype == torch.float32 and not target.requires_grad and find_spec("triton") is not None:
        from degense.engine.training.fused.ssim_cuda import similarity

        return similarity(image, target, _window_on(image.device, image.dtype))
    moments = _Blur.apply(torch.cat([image, target, image * image, target * target, image * target], 2))
    mx, my, xx, yy, xy = moments.chunk(5, 2)
    vx, vy, cov = xx - mx * mx, yy - my * my, xy - mx * my
    return (2 * mx * my + 1e-4) * (2 * cov + 9e-4) / ((mx * mx + my * my + 1e-4) * (vx + vy + 9e-4))


def photometric(image: Picture, target: Picture, valid: Plane, ssim: float) -> tuple[Scalar, Scalar]:
    """(1 − w)·L1 and w·(1 − SSIM), each averaged over valid pixels; w is `ssim`.

    Invalid pixels are shown to the SSIM window as the target, so that they carry no error into their valid neighbours.
    `valid` is 0 or 1.
    """
    weight = valid[..., None]
    count = weight.sum().clamp_min(1) * image.shape[-1]
    shown = image * weight + target * (1 - weight)
    l1 = (1 - ssim) * (shown - target).abs().sum() / count
    structure = ssim * ((1 - ssim_map(shown, target)) * weight).sum() / count if ssim > 0 else torch.zeros_like(l1)
    return l1, structure


def inverse_depth(depth: Plane, alpha: Plane, target: Plane, valid: Plane) -> Scalar:
    """Mean |1/z − 1/z*| over valid pixels that have a depth and are covered.

    `depth` is blended z, not yet divided by alpha; `target` is 0 where unknown.
    """
    weight = valid * (target > 0) * (alpha.detach() > 0.5)
    expected = depth / alpha.clamp_min(1e-6)
    error = (1 / expected.clamp_min(1e-3) - 1 / torch.where(target > 0, target, 1.0)).abs()
    return (error * weight).sum() / weight.sum().clamp_min(1)


def angular(latent: Latents, target: Latents) -> Float[Tensor, " pixels"]:
    """1 − ⟨ṽ_pred, ṽ_gt⟩ per pixel (Eq. 3). A zero vector scores 1 and has a finite gradient."""
    return 1 - (unit(latent) * unit(target)).sum(-1)


def l1(latent: Latents, target: Latents) -> Float[Tensor, " pixels"]:
    """‖f_pred − f_gt‖₁ per pixel, which the coupled baseline distils with."""
    return (latent - target).abs().sum(-1)


def unit(vectors: Float[Tensor, "*batch d"]) -> Float[Tensor, "*batch d"]:
    """v / √(‖v‖² + ε²): unit length for what is longer than ε = 1e-4, finite both ways at zero and near the largest numbers."""
    vectors = vectors.float() if vectors.dtype == torch.float16 else vectors
    size = vectors.detach().abs().amax(-1, keepdim=True).clamp_min(1)  # squares of what is larger than 1 must not overflow
    scaled = vectors / size
    return scaled * torch.rsqrt(scaled.square().sum(-1, keepdim=True) + (1e-4 / size).square())


def region_smoothness(latent: Latents, regions: Int[Tensor, " pixels"], count: int) -> Scalar:
    """L_smooth = E_R[ (1/|R|) Σ_{p∈R} ‖v_pred(p) − v̄_R‖₁ ] (paper §2.3); `regions` are superpixels, 0 … count − 1."""
    size = torch.zeros(count, device=latent.device, dtype=latent.dtype).index_add_(0, regions, torch.ones_like(latent[:, 0]))
    total = torch.zeros(count, latent.shape[1], device=latent.device, dtype=latent.dtype).index_add(0, regions, latent)
    mean = total / size.clamp_min(1)[:, None]
    spread = (latent - rows_of(mean, regions)).abs().sum(1)
    inside = torch.zeros_like(size).index_add(0, regions, spread) / size.clamp_min(1)
    return inside.sum() / (size > 0).sum().clamp_min(1)


def rows_of(values: Float[Tensor, "n d"], index: Int[Tensor, "*shape"]) -> Float[Tensor, "*shape d"]:
    """values[index], where rows are asked for many times.

    On the processor indexing sums their gradients by threads that race for them, so that the same seed would not give the same run;
    `index_select` sums them in order, in half the time. On a GPU indexing sorts the rows first, and `index_select` does not.
    """
    return values.index_select(0, index.reshape(-1)).reshape(*index.shape, values.shape[1])


def nearest_neighbours(points: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """The `count` nearest other points of every point, and how much each counts: exp(−½ (distance / σ)²), σ the median neighbour distance.

    Of points [N, 3], int64 [N, K] and float [N, K]; K = min(`count`, N − 1): a single point has no neighbours.
    """
    place = points.detach().cpu().double().numpy()
    k = min(count, len(place) - 1)
    if k < 1:
        return torch.zeros(len(place), 0, dtype=torch.int64, device=points.device), torch.zeros(len(place), 0, device=points.device)
    distance, index = cKDTree(place).query(place, k + 1, workers=-1)
    distance, index = torch.from_numpy(distance[:, 1:]), torch.from_numpy(index[:, 1:])
    typical = distance.median().clamp_min(1e-9)
    return index.to(points.device), torch.exp(-0.5 * (distance / typical).square()).float().to(points.device)


def rigidity(displacement: Float[Tensor, "n 3"], neighbours: Int[Tensor, "n k"], weights: Float[Tensor, "n k"]) -> Scalar:
    """Mean weighted r / (1 + r / `TORN`) of r = ‖Δμ_i − Δμ_j‖ over neighbour pairs: tissue moves together with what it hangs on.

    Pairs that part for good, an instrument and the tissue behind it or the two sides of a cut, are hardly drawn to each other.
    """
    if displacement.device.type == "cpu" and displacement.dtype == torch.float32:
        return rigidity_cpu.rigidity(displacement, neighbours, weights, TORN)
    difference = displacement[:, None] - rows_of(displacement, neighbours)
    parted = (difference.square().sum(-1) + 1e-12).sqrt()
    return (weights * parted / (1 + parted / TORN)).mean()
