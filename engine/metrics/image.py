"""How like two pictures are. Frames are scored one by one and averaged; a score without anything to score is None."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path

import numpy as np
import torch
from skimage.metrics import structural_similarity

from degense.engine.errors import DegenseError
from degense.engine.metrics.averages import Mean

IDENTICAL = 100.0  # dB: pictures without any difference score this, because infinity cannot be averaged or stored
SSIM_BORDER = 5  # pixels at each edge whose 11 × 11 window is not whole


def psnr(render: np.ndarray, truth: np.ndarray, valid: np.ndarray | None = None) -> float | None:
    """10 · log₁₀(1 / MSE) over the three channels of the valid pixels, dB, at most 100; None without valid pixels.

    Pictures are [H, W, 3], uint8 or float in [0, 1]; `valid` is bool [H, W], by default every pixel.
    """
    a, b = _unit(render, truth)
    error = (a - b) ** 2
    if valid is not None:
        error = error[valid]
    return _decibels(error.mean()) if error.size else None


def psnr_masked_product(render: np.ndarray, truth: np.ndarray, valid: np.ndarray) -> float | None:
    """The peers' protocol (EndoGaussian, Deform3DGS): psnr(render · m, truth · m) over the whole picture.

    Masked pixels count as pixels without error, so this is psnr over valid pixels plus 10 · log₁₀(1 / share of valid pixels): with a
    fifth of the picture masked, 0.97 dB more. Only to compare with published tables.
    """
    a, b = _unit(render, truth)
    return _decibels((((a - b) * valid[..., None]) ** 2).mean()) if valid.any() else None


def ssim(render: np.ndarray, truth: np.ndarray, valid: np.ndarray | None = None) -> float | None:
    """Structural similarity (Wang et al., 2004) of RGB pictures: Gaussian window 11 × 11, σ = 1.5, K = (0.01, 0.03), data range 1.

    The map is averaged over channels and over the valid pixels whose window lies inside the picture. Windows of valid pixels may look
    at masked ones next to them. None when no pixel is left.
    """
    a, b = _unit(render, truth)
    if min(a.shape[:2]) <= 2 * SSIM_BORDER:
        return None
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 1.0, "channel_axis": -1}
    _, similarity = structural_similarity(a, b, full=True, **options)
    inner = np.s_[SSIM_BORDER:-SSIM_BORDER, SSIM_BORDER:-SSIM_BORDER]
    similarity = similarity[inner] if valid is None else similarity[inner][valid[inner]]
    return float(similarity.mean()) if similarity.size else None


def lpips(render: np.ndarray, truth: np.ndarray) -> float | None:
    """Learned perceptual distance (Zhang et al., 2018), AlexNet, on whole pictures; smaller is better.

    None unless the `lpips` package and torchvision's AlexNet weights are on this machine already: nothing is downloaded (`fetch_lpips`).
    """
    network = _lpips_network()
    if network is None:
        return None
    a, b = (torch.from_numpy(np.ascontiguousarray(x.transpose(2, 0, 1)[None], np.float32)) for x in _unit(render, truth))
    with torch.no_grad():
        return float(network(a * 2 - 1, b * 2 - 1))


class ImageScores:
    """Scores of a clip, frame by frame: each is the mean over the frames that have it."""

    def __init__(self) -> None:
        self._means = {name: Mean() for name in ("psnr_mask", "psnr_masked_product", "psnr_full", "ssim", "lpips")}

    def add(self, render: np.ndarray, truth: np.ndarray, valid: np.ndarray) -> None:
        """One frame: pictures [H, W, 3], uint8 or float in [0, 1], and the pixels that count, bool [H, W].

        `psnr_mask` and `ssim` look at valid pixels; `psnr_full` and `lpips` at all.
        """
        self._means["psnr_mask"].add(psnr(render, truth, valid))
        self._means["psnr_masked_product"].add(psnr_masked_product(render, truth, valid))
        self._means["psnr_full"].add(psnr(render, truth))
        self._means["ssim"].add(ssim(render, truth, valid))
        self._means["lpips"].add(lpips(render, truth))

    def result(self) -> dict[str, float | None]:
        """`psnr_mask`, `psnr_masked_product`, `psnr_full` (dB), `ssim`, `lpips`."""
        return {name: mean.value for name, mean in self._means.items()}


def _unit(*pictures: np.ndarray) -> list[np.ndarray]:
    """As float64 in [0, 1]; pictures that differ in shape are a defect of the caller."""
    if len({p.shape for p in pictures}) > 1:
        raise ValueError(f"pictures differ in shape: {[p.shape for p in pictures]}")
    return [p / 255.0 if p.dtype == np.uint8 else np.clip(p.astype(np.float64), 0, 1) for p in pictures]


def _decibels(mse: float) -> float:
    return float(min(IDENTICAL, -10 * np.log10(max(mse, 1e-30))))


def fetch_lpips() -> None:
    """Make `lpips` answer: fetches AlexNet's weights, 244 MB, if they are not on this machine yet.

    No package ships them: `lpips` has its own linear layers, and takes the network from torchvision, which downloads it. DegenseError
    without the packages, and when the weights cannot be downloaded.
    """
    _lpips_network.cache_clear()
    try:
        import lpips as package

        package.LPIPS(net="alex", verbose=False)
    except (ImportError, RuntimeError) as error:  # torchvision of another torch raises RuntimeError
        raise DegenseError(f"LPIPS needs the packages lpips and torchvision: pip install 'degense[lpips]' ({error}).") from error
    except OSError as error:
        raise DegenseError(f"LPIPS needs AlexNet's weights, which could not be downloaded ({error}).") from error


@cache
def _lpips_network() -> torch.nn.Module | None:
    if importlib.util.find_spec("lpips") is None or not any((Path(torch.hub.get_dir()) / "checkpoints").glob("alexnet-*.pth")):
        return None
    import lpips as package

    return package.LPIPS(net="alex", verbose=False).eval()
