"""The fused rigidity against plain torch in float64."""

import torch

from degense.engine.threads import one_torch_thread
from degense.engine.training.losses import nearest_neighbours, rigidity


def test_value_and_gradient_match_plain_torch_in_float64():
    random = torch.Generator().manual_seed(5)
    neighbours, weights = nearest_neighbours(torch.randn(700, 3, generator=random), 6)
    moved = torch.randn(700, 3, generator=random) * 0.02
    moved[3] = moved[neighbours[3, 0]]  # a pair that moves alike: the norm's slope is not defined there
    fused, exact = moved.requires_grad_(), moved.detach().double().requires_grad_()
    found, expected = rigidity(fused, neighbours, weights), rigidity(exact, neighbours, weights.double())
    (3 * found).backward()
    (3 * expected).backward()
    torch.testing.assert_close(found.double(), expected, rtol=1e-5, atol=0)
    torch.testing.assert_close(fused.grad.double(), exact.grad, rtol=1e-4, atol=1e-9)


def test_the_number_of_threads_changes_no_bit():
    random = torch.Generator().manual_seed(6)
    neighbours, weights = nearest_neighbours(torch.randn(2000, 3, generator=random), 6)
    moved = (torch.randn(2000, 3, generator=random) * 0.02).requires_grad_()
    results = []
    for threads in (1, 3):
        with one_torch_thread(kernels=threads):
            loss = rigidity(moved, neighbours, weights)
            results.append((loss.item(), torch.autograd.grad(loss, moved)[0]))
    assert results[0][0] == results[1][0]
    assert torch.equal(results[0][1], results[1][1])


def test_a_single_gaussian_has_no_rigidity():
    moved = torch.randn(1, 3, requires_grad=True)
    loss = rigidity(moved, *nearest_neighbours(torch.randn(1, 3), 6))
    loss.backward()
    assert loss == 0
    assert not moved.grad.any()
