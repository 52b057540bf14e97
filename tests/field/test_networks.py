"""The fused networks of the CPU, with their gradients, against plain torch in float64."""

import copy

import pytest
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.field.branches import Branch, Kinematics
from degense.engine.field.networks_cpu import STRETCH, branch, networks
from degense.engine.threads import one_torch_thread


def example(count, linear=False):
    """Networks with something to say, features of more rows than a block, weights of the outputs; the second decoder reads 2 of 3 rows."""
    torch.manual_seed(count)
    parts = torch.nn.ModuleList([Kinematics(24, linear=linear), Branch(64, 11), Branch(64, 3)])
    for part in parts.parameters():
        if not part.any() or part.ndim == 1:
            torch.nn.init.normal_(part, 0, 0.1)
    return parts, torch.randn(count, 24), (torch.randn(count, 11), torch.randn(2 * count // 3, 3))


def fused(parts, features):
    kinematics, geometry, appearance = parts
    return networks(features, kinematics, [(geometry.decode, len(features)), (appearance.decode, 2 * len(features) // 3)])


def plain(parts, features):
    latent = parts[0](features)
    return parts[1](latent), parts[2](latent[: 2 * len(features) // 3])


def outputs_and_gradients(function, parts, features, weights):
    features = features.clone().requires_grad_()
    outputs = function(parts, features)
    total = sum((output * weight.to(features)).sum() for output, weight in zip(outputs, weights, strict=True))
    return [*(output.detach() for output in outputs), *torch.autograd.grad(total, [features, *parts.parameters()])]


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("count", [333, 2 * STRETCH + 70])
def test_values_and_gradients_are_those_of_plain_torch_in_float64(count, linear):
    parts, features, weights = example(count, linear)
    exact = outputs_and_gradients(plain, copy.deepcopy(parts).double(), features.double(), weights)
    for one, other in zip(outputs_and_gradients(fused, parts, features, weights), exact, strict=True):
        assert one.shape == other.shape
        assert (one - other).norm() / other.norm() < 1e-4  # a rectified number so near 0 that its sign is rounding


@pytest.mark.parametrize("count", [333, 2 * STRETCH + 70])
def test_a_branch_of_its_own_is_that_of_plain_torch_in_float64(count):
    torch.manual_seed(count)
    part, inputs, weights = torch.nn.ModuleList([Branch(80, 8)]), torch.randn(count, 80), [torch.randn(count, 8)]
    torch.nn.init.normal_(part[0].decode[2].weight, 0, 0.1)
    exact = outputs_and_gradients(lambda twin, of: [twin[0](of)], copy.deepcopy(part).double(), inputs.double(), weights)
    found = outputs_and_gradients(lambda twin, of: [branch(of, twin[0].decode)], part, inputs, weights)
    for one, other in zip(found, exact, strict=True):
        assert one.shape == other.shape
        assert (one - other).norm() / other.norm() < 1e-4


def test_the_number_of_threads_changes_no_bit():
    parts, features, weights = example(3 * STRETCH)
    several = outputs_and_gradients(fused, parts, features, weights)
    with one_torch_thread(1):
        one = outputs_and_gradients(fused, parts, features, weights)
    assert all(torch.equal(a, b) for a, b in zip(several, one, strict=True))


def test_a_decoder_that_is_not_asked_for_gets_no_gradient():
    parts, features, (weight, _) = example(200)
    (fused(parts, features)[0] * weight).sum().backward()
    assert parts[1].decode[2].weight.grad.any()
    assert not parts[2].decode[2].weight.grad.any()


def test_centres_of_some_rows_at_another_time():
    """Values and gradients as of all rows, of which the others count nothing."""
    torch.manual_seed(1)
    count, rows = 90, torch.arange(1, 90, 4)
    canonical = {
        "means": torch.rand(count, 3) * 2 - 1,
        "log_scales": torch.randn(count, 3) - 3,
        "quats": torch.randn(count, 4),
        "logits": torch.randn(count),
        "colors": torch.rand(count, 3),
        "semantics": torch.randn(count, 0),
        "color_residuals": torch.randn(count, 0, 3),
        "temporal_windows": torch.rand(count, 2),
        "velocities": torch.randn(count, 3),
    }
    model = SceneModel(FieldConfig(resolution=8, time_resolution=5), torch.tensor([[-1.0, -1, -1], [1, 1, 1]]), canonical)
    torch.nn.init.normal_(model.geometry.decode[2].weight, 0, 0.1)
    weight, found = torch.randn(len(rows), 3), []
    for asked in (None, rows):
        model.zero_grad()
        means = model.at(0.3, semantics=False, other=-0.6, rows=asked).means_at_other
        means = means if asked is not None else means[rows]
        (means * weight).sum().backward()
        found.append([means.detach(), *(parameter.grad for parameter in model.parameters() if parameter.grad is not None)])
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)
    still = model.at(0.3, deform=False, semantics=False, other=-0.6, rows=rows).means_at_other
    torch.testing.assert_close(still, found[0][0], rtol=1e-4, atol=1e-5)
