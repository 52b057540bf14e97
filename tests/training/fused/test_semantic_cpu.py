"""The fused semantic loss against plain torch in float64, values and gradients."""

import pytest
import torch

from degense.engine.training.fused import semantic_cpu
from degense.engine.training.losses import angular, region_smoothness


def example(pixels=700, words=5, length=6):
    torch.manual_seed(4)
    drawn = torch.randn(pixels, length)
    drawn[:3] = 0.0  # nothing is drawn there
    labelled = torch.randperm(pixels)[: pixels // 2].int()
    labels = semantic_cpu.Labels(
        torch.randn(words, length), torch.randint(words, (len(labelled),)).int(), labelled, torch.rand(len(labelled))
    )
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
        target = labels.latents.to(values)[labels.latent_of]
        return (angular(values[labels.pixels], target) * labels.weight).sum() / len(labels.pixels)

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
    few = semantic_cpu.Labels(labels.latents, labels.latent_of[:count], labels.pixels[:count], labels.weight[:count])
    value, grad = gradient(lambda values: semantic_cpu.align(values, few), drawn)
    assert torch.isfinite(value)
    assert grad.any(1).sum() == count
