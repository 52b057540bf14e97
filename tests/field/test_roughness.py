"""The roughness of planes and curves: the fused kernels against differences in plain torch, in float64."""

import pytest
import torch

from degense.engine.field.roughness import ACROSS, ALONG, APART, BEND, plain_roughness, roughness


@pytest.mark.parametrize("kinds", [(ALONG, ACROSS), (ALONG, BEND, APART), (APART, ALONG), (ACROSS, ALONG, APART, BEND)])
@pytest.mark.parametrize("shape", [(3, 7, 9, 16), (1, 40, 14, 3), (2, 3, 6, 8), (1, 1, 5, 3), (2, 2, 1, 4)])
def test_fused_means_and_gradients_match_plain_torch_in_float64(shape, kinds):
    random = torch.Generator().manual_seed(sum(shape))
    values, weights = torch.randn(shape, generator=random), torch.rand(len(kinds), generator=random)
    fused, exact = values.requires_grad_(), values.detach().double().requires_grad_()
    found = torch.stack(roughness(fused, *kinds, centre=0.3))
    expected = plain_roughness(exact, kinds, 0.3)[list(kinds)]
    (found * weights).sum().backward()
    (expected * weights.double()).sum().backward()
    torch.testing.assert_close(found.double(), expected, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(fused.grad.double(), exact.grad, rtol=1e-4, atol=1e-6)


def test_differences_by_hand():
    """Two rows of three numbers: 0 1 3 and 2 2 2."""
    values = torch.tensor([[0.0, 1, 3], [2, 2, 2]])[None, :, :, None]
    along, across, apart = roughness(values, ALONG, ACROSS, APART, centre=1.0)
    assert along == pytest.approx((1 + 4 + 0 + 0) / 4)
    assert across == pytest.approx((4 + 1 + 1) / 3)
    assert apart == pytest.approx((1 + 0 + 2 + 1 + 1 + 1) / 6)
    [bend] = roughness(torch.tensor([0.0, 1, 4, 9])[None, :, None, None], BEND)
    assert bend == pytest.approx(4)  # of k² the second difference is 2 everywhere
