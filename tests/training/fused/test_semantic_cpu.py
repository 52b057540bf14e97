"""The fused semantic loss against plain torch in float64, values and gradients."""

import pytest
import torch

from degense.engine.training.fused import semantic_cpu
from degense.engine.training.losses import angular, region_smoothness


def example(pixels=700, words=5, length=6):
    torch.manual_seed(4)
    drawn = torch.randn(pixels, length)
    drawn[:3] = 0.0  # nothing is drawn there
    known = torch.rand(pixels) < 0.5
    said = torch.where(known, torch.randint(words, (pixels,)), -1).int()
    labels = semantic_cpu.Labels(torch.randn(words, length), said, torch.rand(pixels) * known, known.sum().float())
    regions = torch.randint(40, (pixels,)).int()
    regions[regions == 7] = 8  # a number that no pixel has
    return drawn, labels, regions


def gradient(function, drawn):
    drawn = drawn.clone().requires_grad_()
    value = function(drawn)
    return value.detach(), torch.autograd.grad(3 * value, drawn)[0]


def check(fused, plain, drawn):
    for one, other in zip(gradient(fused, drawn), gradient(plain, drawn.double()), strict=True):
        torch.testing.assert_close(one.double(), other, rtol=1e-4, atol=1e-7)


def test_alignment():
    drawn, labels, _ = example()

    def plain(values):
        known = labels.latent_of >= 0
        target = labels.latents.to(values)[labels.latent_of[known]]
        return (angular(values[known], target) * labels.weight[known]).sum() / known.sum()

    check(lambda values: semantic_cpu.align(values, labels), plain, drawn)


def test_smoothness_of_regions():
    drawn, _, regions = example()
    check(
        lambda values: semantic_cpu.region_smoothness(values, regions, 40),
        lambda values: region_smoothness(values, regions, 40),
        drawn + torch.randn_like(drawn) * 1e-3,
    )


@pytest.mark.parametrize("count", [0, 1])
def test_frames_of_few_labels(count):
    drawn, labels, _ = example()
    kept = torch.cumsum(labels.latent_of >= 0, 0) <= count
    said, weight = torch.where(kept, labels.latent_of, -1), torch.where(kept, labels.weight, 0.0)
    few = semantic_cpu.Labels(labels.latents, said, weight, torch.tensor(1.0))
    value, grad = gradient(lambda values: semantic_cpu.align(values, few), drawn)
    assert torch.isfinite(value)
    assert grad.any(1).sum() == count
