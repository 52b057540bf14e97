"""How pixels look, on the CPU and by the products that a GPU makes, and the network that names them."""

import cv2
import numpy as np
import pytest
import torch

from degense.engine.training.semantic.appearance import ROWS, SCALES, Appearance, Looks

SIZE = 97, 64


def picture(seed, size=SIZE):
    noise = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 1.5)


def looked_up(lab, scale):
    """Mean, standard deviation and slope of lightness by the definition, in double precision: a mirrored window around each pixel."""
    reach = round(scale * 8 + 1) // 2
    taps = np.exp(-(np.arange(-reach, reach + 1) ** 2) / (2 * scale**2))
    weight = np.outer(taps, taps) / taps.sum() ** 2
    padded = np.pad(lab.astype(np.float64), ((reach, reach), (reach, reach), (0, 0)), "reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, weight.shape, (0, 1))
    mean, square = ((values * weight).sum((-1, -2)) for values in (windows, windows**2))
    beside = np.pad(mean[..., 0], 1, "reflect")
    sobel = np.outer([1, 2, 1], [-1, 0, 1])
    around = np.lib.stride_tricks.sliding_window_view(beside, (3, 3))
    slope = np.hypot((around * sobel).sum((-1, -2)), (around * sobel.T).sum((-1, -2)))
    return np.concatenate([mean, np.sqrt(np.maximum(square - mean**2, 0)), slope[..., None]], -1)


@pytest.mark.parametrize("by_products", [False, True])
def test_looks_are_colour_and_what_is_around(by_products):
    image = picture(0, (41, 36))
    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    looks = Looks((41, 36), torch.device("cpu"))
    found = looks.by_products(torch.from_numpy(lab)) if by_products else looks(image)
    wanted = np.concatenate([lab, *(looked_up(lab, scale) for scale in SCALES)], -1)
    np.testing.assert_allclose(found.numpy(), wanted.reshape(-1, wanted.shape[2]), atol=0.02)


@pytest.mark.cuda
def test_a_gpu_sees_what_a_processor_sees():
    image = picture(1)
    here, there = (Looks(SIZE, torch.device(name))(image) for name in ("cpu", "cuda"))
    torch.testing.assert_close(there.cpu(), here, rtol=1e-4, atol=0.02)


def test_all_that_looks_alike_is_called_as_most_of_it_was():
    random = torch.Generator().manual_seed(3)
    features = torch.randn(ROWS + 1000, 4, generator=random)
    true = (features[:, 0] > 0).long()
    wrong = torch.rand(len(features), generator=random) < 0.2
    appearance = Appearance(features, torch.nn.functional.one_hot(true ^ wrong.long(), 2).float(), 0)
    said = appearance(features)
    assert said.shape == (len(features), 2)
    torch.testing.assert_close(said.exp().sum(1), torch.ones(len(features)))
    assert (said.argmax(1) == true)[features[:, 0].abs() > 0.2].float().mean() > 0.98
