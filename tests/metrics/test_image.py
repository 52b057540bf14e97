"""Image scores against brute force."""

import sys
import types
from urllib.error import URLError

import numpy as np
import pytest
import torch

from degense.engine.errors import DegenseError
from degense.engine.metrics import image
from degense.engine.metrics.image import ImageScores, psnr, psnr_masked_product, ssim


def pictures(seed, shape=(24, 31)):
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 256, (*shape, 3), dtype=np.uint8)
    render = np.clip(truth + rng.normal(0, 12, truth.shape), 0, 255).astype(np.uint8)
    return render, truth, rng.random(shape) < 0.7


def loop_psnr(render, truth, pixels, count):
    total = 0.0
    for y, x in pixels:
        for c in range(3):
            total += ((int(render[y, x, c]) - int(truth[y, x, c])) / 255) ** 2
    return -10 * np.log10(total / (3 * count))


def test_psnr_counts_valid_pixels_only_and_the_product_counts_all():
    render, truth, valid = pictures(1)
    pixels = list(zip(*np.nonzero(valid), strict=True))
    np.testing.assert_allclose(psnr(render, truth, valid), loop_psnr(render, truth, pixels, len(pixels)))
    np.testing.assert_allclose(psnr_masked_product(render, truth, valid), loop_psnr(render, truth, pixels, valid.size))
    gain = psnr_masked_product(render, truth, valid) - psnr(render, truth, valid)
    np.testing.assert_allclose(gain, -10 * np.log10(valid.mean()))
    spoilt = render.copy()
    spoilt[~valid] = 255 - spoilt[~valid]
    assert psnr(spoilt, truth, valid) == psnr(render, truth, valid)
    assert psnr(spoilt, truth) < psnr(render, truth)


def test_float_and_byte_pictures_agree_and_floats_are_clipped():
    render, truth, valid = pictures(2)
    np.testing.assert_allclose(psnr(render / 255, truth / 255, valid), psnr(render, truth, valid))
    assert psnr(np.full((20, 20, 3), 1.7), np.ones((20, 20, 3))) == 100.0


def test_nothing_to_score_is_none_and_no_difference_is_100():
    render, truth, valid = pictures(3)
    nothing = np.zeros_like(valid)
    assert psnr(render, truth, nothing) is None
    assert psnr_masked_product(render, truth, nothing) is None
    assert ssim(render, truth, nothing) is None
    assert ssim(render[:9], truth[:9]) is None
    assert psnr(truth, truth) == 100.0
    assert ssim(truth, truth) == pytest.approx(1.0)
    with pytest.raises(ValueError, match="shape"):
        psnr(render, truth[:-1])


def test_ssim_matches_its_definition():
    render, truth, valid = pictures(4)
    offsets = np.arange(-5, 6)
    window = np.exp(-(offsets[:, None] ** 2 + offsets[None] ** 2) / (2 * 1.5**2))
    window /= window.sum()
    values = []
    for y in range(5, 24 - 5):
        for x in range(5, 31 - 5):
            if not valid[y, x]:
                continue
            for c in range(3):
                a, b = (p[y - 5 : y + 6, x - 5 : x + 6, c] / 255 for p in (render, truth))
                ma, mb = (window * a).sum(), (window * b).sum()
                va, vb = (window * (a - ma) ** 2).sum(), (window * (b - mb) ** 2).sum()
                cov = (window * (a - ma) * (b - mb)).sum()
                values.append((2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma**2 + mb**2 + 1e-4) * (va + vb + 9e-4)))
    np.testing.assert_allclose(ssim(render, truth, valid), np.mean(values), rtol=1e-6)


def test_a_clip_is_the_mean_of_its_frames():
    scores, frames = ImageScores(), [pictures(s) for s in (5, 6, 7)]
    for frame in frames:
        scores.add(*frame)
    render, truth, _ = frames[0]
    scores.add(render, truth, np.zeros(truth.shape[:2], bool))
    result = scores.result()
    np.testing.assert_allclose(result["psnr_mask"], np.mean([psnr(*f) for f in frames]))
    np.testing.assert_allclose(result["psnr_full"], np.mean([psnr(r, t) for r, t, _ in [*frames, frames[0]]]))
    np.testing.assert_allclose(result["ssim"], np.mean([ssim(*f) for f in frames]))
    assert set(ImageScores().result().values()) == {None}


def test_lpips_needs_what_is_on_the_machine(monkeypatch, tmp_path):
    render, truth, _ = pictures(8)
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    image._lpips_network.cache_clear()
    assert image.lpips(render, truth) is None
    monkeypatch.setitem(sys.modules, "lpips", None)
    with pytest.raises(DegenseError, match=r"needs the packages lpips and torchvision: pip install 'degense\[lpips\]'"):
        image.fetch_lpips()

    class Network(torch.nn.Module):
        def __init__(self, net, verbose):
            super().__init__()
            assert (net, verbose) == ("alex", False)
            if offline:
                raise URLError("no route to host")
            (tmp_path / "checkpoints").mkdir(exist_ok=True)  # as torchvision, which downloads what is missing
            (tmp_path / "checkpoints" / "alexnet-owt-7be5be79.pth").write_bytes(b"")

        def forward(self, a, b):
            assert a.shape == (1, 3, 24, 31)
            assert -1 <= a.min() < 0 < a.max() <= 1
            return (a - b).abs().mean().reshape(1, 1, 1, 1)

    package = types.ModuleType("lpips")
    package.LPIPS = Network
    package.__spec__ = __import__("importlib.machinery").machinery.ModuleSpec("lpips", None)
    monkeypatch.setitem(sys.modules, "lpips", package)
    offline = True
    assert image.lpips(render, truth) is None  # nothing is downloaded unless it is asked for
    with pytest.raises(DegenseError, match=r"weights, which could not be downloaded .*no route"):
        image.fetch_lpips()
    offline = False
    image.fetch_lpips()
    np.testing.assert_allclose(image.lpips(render, truth), np.abs(render / 255 - truth / 255).mean() * 2, rtol=1e-5)
    image._lpips_network.cache_clear()
