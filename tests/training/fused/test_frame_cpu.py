"""The fused loss of a frame against plain torch in float64, values and gradients."""

import numpy as np
import pytest
import torch

from degense.engine.research.bench.timing import threads
from degense.engine.training.config import TrainConfig
from degense.engine.training.passes import FrameLoss


def example(height=23, width=37):
    random = torch.Generator().manual_seed(3)
    image = torch.rand(height, width, 4, generator=random) * torch.tensor([1, 1, 1, 0.7]) + torch.tensor([0, 0, 0, 0.1])
    alpha = torch.rand(height, width, generator=random)
    recorded = (torch.rand(height, width, 3, generator=random) * 255).byte()
    visible = torch.rand(height, width, generator=random) > 0.3
    known = torch.rand(height, width, generator=random) * (torch.rand(height, width, generator=random) > 0.4)
    return image, alpha, (recorded, visible, known)


def found(image, alpha, frame, depth, ssim=0.2):
    image, alpha = image.clone().requires_grad_(), alpha.clone().requires_grad_()
    loss, terms, error = FrameLoss(TrainConfig(ssim=ssim), depth=depth)(image, alpha, *frame)
    (3 * loss).backward()
    return loss, terms, error, image.grad, alpha.grad if alpha.grad is not None else torch.zeros_like(alpha)


@pytest.mark.parametrize(("depth", "ssim"), [(0.5, 0.2), (0.0, 0.2), (0.5, 0.0)])
def test_it_is_what_plain_torch_finds_in_float64(depth, ssim):
    image, alpha, frame = example()
    plain = found(image.double(), alpha.double(), (*frame[:2], frame[2].double()), depth, ssim)
    for fused, exact in zip(found(image, alpha, frame, depth, ssim), plain, strict=True):
        np.testing.assert_allclose(fused.detach(), exact.detach(), rtol=2e-4, atol=2e-7)


def test_nothing_visible_has_no_loss_and_no_gradient():
    image, alpha, (recorded, visible, known) = example()
    loss, _, error, *grads = found(image, alpha, (recorded, torch.zeros_like(visible), known), 0.5)
    assert loss == error == 0
    assert not any(grad.any() for grad in grads)


def test_the_same_bits_whatever_the_number_of_threads():
    one, two = [], []
    for count, results in ((1, one), (2, two)):
        with threads(count):
            results.extend(found(*example(), 0.5))
    assert all(torch.equal(a, b) for a, b in zip(one, two, strict=True))
