"""A CUDA graph gives what the plain function gives, call after call."""

import pytest
import torch

from degense.engine.field.cuda_graphs import graphed


def chain(x, y, scale):
    hidden = (x @ y).tanh()
    return (hidden * scale).sum(1), hidden.detach().square()


def test_on_the_cpu_nothing_is_graphed():
    assert graphed(chain, (torch.zeros(2, 2),)) is chain


@pytest.mark.cuda
def test_a_graph_repeats_the_function_and_its_gradients_with_other_inputs_and_changed_parameters():
    torch.manual_seed(0)
    weight, unused = (torch.randn(8, 8, device="cuda", requires_grad=True) for _ in range(2))

    def function(x, scale):
        return chain(x, weight, scale)

    example = torch.randn(5, 8, device="cuda", requires_grad=True), torch.ones((), device="cuda")
    replay = graphed(function, example, [weight, unused])
    for i in range(3):
        x, scale, pull = torch.randn(5, 8, device="cuda", requires_grad=True), torch.tensor(float(i + 1)).cuda(), torch.randn(5).cuda()
        expected = function(x, scale)
        wanted = torch.autograd.grad((expected[0] * pull).sum(), [x, weight])
        weight.grad = None
        results = replay(x, scale)
        (results[0] * pull).sum().backward()
        assert not results[1].requires_grad
        for found, right in zip((*results, x.grad, weight.grad), (*expected, *wanted), strict=True):
            assert torch.allclose(found, right, atol=2e-2)
        assert unused.grad is None
        with torch.no_grad():
            weight += 0.1


@pytest.mark.cuda
def test_two_graphs_of_one_step_add_their_gradients():
    weight = torch.randn(4, device="cuda", requires_grad=True)
    x = torch.ones(4, device="cuda")
    one, two = (graphed(lambda x, k=k: ((x * weight * k).sum(),), (x,), [weight]) for k in (2.0, 3.0))
    for _ in range(2):
        weight.grad = None
        (one(x)[0] + two(x)[0]).backward()
        assert torch.allclose(weight.grad, torch.full((4,), 5.0, device="cuda"))
