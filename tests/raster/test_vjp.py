"""Vector–Jacobian products against torch's own."""

import subprocess
import sys

import torch

from degense.engine.raster.vjp import vjp


def test_it_is_torchs():
    torch.manual_seed(0)
    x, y, unused = (torch.randn(4, 3, dtype=torch.float64, requires_grad=True) for _ in range(3))
    outputs = [(x @ y.T).tanh(), x.exp().sum(0), x * y]
    pulls = [torch.randn_like(output) for output in outputs]
    kept = [pull.clone() for pull in pulls]
    expected = torch.autograd.grad(outputs, [x, y], pulls, retain_graph=True)
    *found, nothing = vjp(outputs, [x, y, unused], pulls)
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other)
    assert nothing is None
    assert all(torch.equal(one, other) for one, other in zip(pulls, kept, strict=True))


def test_it_imports_no_compiler():
    code = (
        "import sys, torch; from degense.engine.raster.vjp import vjp\n"
        "x = torch.ones(3, requires_grad=True)\n"
        "assert vjp([2 * x], [x], [torch.ones(3)])[0].tolist() == [2, 2, 2]\n"
        "assert 'sympy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
