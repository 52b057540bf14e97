"""Adam against torch's own."""

import subprocess
import sys

import pytest
import torch

from degense.engine.training.adam import Adam

SHAPES = [[(7, 3), (5,)], [(4, 2, 2)]]
RATES = [1e-2, 3e-3]


def parameters(device):
    random = torch.Generator().manual_seed(0)
    return [[torch.nn.Parameter(torch.randn(shape, generator=random).to(device)) for shape in group] for group in SHAPES]


def both(device, decay=0.0):
    """Ours and torch's, each with parameters of its own."""
    ours, theirs = parameters(device), parameters(device)
    groups = [[{"params": params, "lr": rate} for params, rate in zip(group, RATES, strict=True)] for group in (ours, theirs)]
    oracle = torch.optim.AdamW(groups[1], eps=1e-15, weight_decay=decay, foreach=False)
    return (Adam(groups[0], decay=decay), [*ours[0], *ours[1]]), (oracle, [*theirs[0], *theirs[1]])


def steps(ours, theirs, count, leave_out=()):
    """Steps of both with the same gradients, in memory that stays, and a rate that changes."""
    (mine, left), (oracle, right) = ours, theirs
    held = [torch.zeros_like(parameter) for parameter in left]
    random = torch.Generator().manual_seed(1)
    for step in range(count):
        for k, (a, b, gradient) in enumerate(zip(left, right, held, strict=True)):
            gradient.copy_(torch.randn(a.shape, generator=random))
            a.grad, b.grad = (None, None) if (step, k) in leave_out else (gradient, gradient.clone())
        for optimizer in (mine, oracle):
            optimizer.param_groups[1]["lr"] = RATES[1] / (step + 1)
            optimizer.step()
    return list(zip(left, right, strict=True))


@pytest.mark.parametrize("decay", [0.0, 0.1])
def test_it_does_what_torch_does(decay):
    for a, b in steps(*both("cpu", decay), 6):
        torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-6)


def test_what_has_no_gradient_stays_and_its_moments_wait():
    ours, theirs = both("cpu")
    for a, b in steps(ours, theirs, 4, leave_out={(0, 1), (2, 2)}):
        torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-6)
    assert float(ours[0].state[ours[1][1]]["step"]) == 3


def test_gradients_are_forgotten():
    (mine, left), _ = both("cpu")
    left[0].grad = torch.ones_like(left[0])
    mine.zero_grad()
    before = [parameter.detach().clone() for parameter in left]
    mine.step()
    assert all(torch.equal(a, b) for a, b in zip(before, left, strict=True))


def test_it_does_not_load_torchs_compiler():
    made = "from degense.engine.training.adam import Adam; Adam([{'params': [torch.ones(1)], 'lr': 1.0}])"
    subprocess.run([sys.executable, "-c", f"import sys, torch; {made}; assert 'torch._dynamo' not in sys.modules"], check=True, timeout=120)


@pytest.mark.cuda
@pytest.mark.parametrize("decay", [0.0, 0.1])
def test_a_graph_does_the_same(decay):
    ours, theirs = both("cuda", decay)
    for a, b in steps(ours, theirs, 6):
        torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-6)


@pytest.mark.cuda
def test_graphs_know_which_parameters_learn():
    ours, theirs = both("cuda")
    for a, b in steps(ours, theirs, 12, leave_out={(k, 0) for k in (3, 5, 6, 9)}):
        torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-6)
