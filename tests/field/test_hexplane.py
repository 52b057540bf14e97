"""The fused HexPlane against its plain twin, and the twin against a loop."""

import numpy as np
import pytest
import torch
from scipy.interpolate import BSpline

from degense.engine.field import hexplane_cpu
from degense.engine.field.hexplane import HexPlane, at_time, sample_level, sample_levels


def brute(points, space, line):
    """One level by loops in float64."""
    cells = space.shape[1] - 1
    out = np.ones((len(points), space.shape[-1]))
    for n, point in enumerate(points):
        place = (point + 1) / 2 * cells
        low = np.clip(np.floor(place).astype(int), 0, cells - 1)
        w = place - low
        for plane, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
            value = 0
            for i in (0, 1):
                for j in (0, 1):
                    value = value + (w[a] if i else 1 - w[a]) * (w[b] if j else 1 - w[b]) * space[plane, low[b] + j, low[a] + i]
            out[n] *= value
        for axis in range(3):
            out[n] *= (1 - w[axis]) * line[axis, low[axis]] + w[axis] * line[axis, low[axis] + 1]
    return out


@pytest.mark.parametrize("channels", [8, 16])
def test_twin_matches_a_loop(channels):
    random = np.random.default_rng(channels)
    points = np.concatenate([random.uniform(-1, 1, (20, 3)), [[-1, -1, -1], [1, 1, 1], [0, 1, -1]]])
    space, line = random.normal(size=(3, 7, 7, channels)), random.normal(size=(3, 7, channels))
    twin = sample_level(torch.from_numpy(points), torch.from_numpy(space), torch.from_numpy(line))
    np.testing.assert_allclose(twin.numpy(), brute(points, space, line), atol=1e-12)


@pytest.mark.parametrize("channels", [4, 12])
def test_channels_that_fill_no_block_are_left_to_the_twin(channels):
    """The fused gradient writes whole blocks: beyond the end of such planes."""
    torch.manual_seed(channels)
    plane, points = HexPlane(channels, 6, 4, (1,)), torch.rand(50, 3) * 2 - 1
    plane(points, 0.3).square().sum().backward()
    found = [level.grad.clone() for level in plane.parameters()]
    plane.zero_grad()
    sample_levels(points, list(plane.space), plane.lines(0.3)).square().sum().backward()
    for one, other in zip(found, plane.parameters(), strict=True):
        torch.testing.assert_close(one, other.grad)


def test_fused_values_and_gradients_match_the_twin_in_float64():
    """Of two queries, each with lines of its own."""
    torch.manual_seed(3)
    queries = torch.rand(500, 3) * 2 - 1, torch.rand(70, 3) * 2 - 1
    spaces, lines = [torch.randn(3, 9, 9, 16), torch.randn(3, 17, 17, 8)], [torch.randn(3, 9, 16), torch.randn(3, 17, 8)]
    levels, weights = [*spaces, *lines, *(torch.randn_like(line) for line in lines)], torch.randn(570, 24)
    results = []
    for cast, sample in ((torch.float32, hexplane_cpu.sample), (torch.float64, _one_after_the_other)):
        planes = [plane.to(cast, copy=True).requires_grad_() for plane in levels]
        out = sample([points.to(cast) for points in queries], planes[:2], [planes[2:4], planes[4:]])
        (out * weights.to(cast)).sum().backward()
        results.append((out.detach().double(), *(plane.grad.double() for plane in planes)))
    for fused, exact in zip(*results, strict=True):
        assert (fused - exact).norm() / exact.norm() < 1e-5


def _one_after_the_other(queries, spaces, lines):
    return torch.cat([sample_levels(points, spaces, of) for points, of in zip(queries, lines, strict=True)])


@pytest.mark.parametrize("width", [6, 20])
def test_time_runs_along_a_cubic_spline_and_is_clamped(width):
    """Against SciPy's B-spline with the outermost knots repeated."""
    values = np.random.default_rng(5).normal(size=(7, width))
    padded = np.concatenate([values[:1], values, values[-1:]])
    spline = BSpline(np.arange(-3, 10), padded, 3)
    knots = torch.from_numpy(values)[None]
    for t in (-1.0, -0.93, -0.2, 0.0, 0.41, 1.0):
        np.testing.assert_allclose(at_time(knots, t)[0].numpy(), spline((t + 1) / 2 * 6), atol=1e-12)
    assert torch.equal(at_time(knots, -7.0), at_time(knots, -1.0))
    assert torch.equal(at_time(knots, 3.0), at_time(knots, 1.0))
    assert torch.allclose(at_time(torch.full((2, 5, 3), 0.7), 0.123), torch.tensor(0.7))
    assert torch.equal(at_time(knots[:, :1], 0.5), knots[:, 0])


@pytest.mark.cuda
@pytest.mark.parametrize("channels", [8, 16, 24])
def test_the_gpus_fused_twin_in_values_and_gradients(channels):
    hexplane_cuda = pytest.importorskip("degense.engine.field.hexplane_cuda")
    torch.manual_seed(channels)
    points = torch.cat([torch.rand(3000, 3) * 2 - 1, torch.tensor([[-1.0, -1, -1], [1, 1, 1]])])
    space, line = torch.randn(3, 33, 33, channels), torch.randn(3, 33, channels)
    weights, results = torch.randn(len(points), channels), []
    for device, cast, sample in (("cuda", torch.float32, hexplane_cuda.sample), ("cpu", torch.float64, sample_level)):
        plane, lines = (tensor.to(device, cast, copy=True).requires_grad_() for tensor in (space, line))
        out = sample(points.to(device, cast), plane, lines)
        (out * weights.to(device, cast)).sum().backward()
        results.append([tensor.double().cpu() for tensor in (out.detach(), plane.grad, lines.grad)])
    for fused, exact in zip(*results, strict=True):
        assert (fused - exact).norm() / exact.norm() < 1e-5


def test_points_outside_the_box_and_without_a_gradient():
    planes = HexPlane(8, 8, 4)
    points = torch.tensor([[9.0, -9.0, 0.0]], requires_grad=True)
    out = planes(points, 0.3)
    out.sum().backward()
    assert torch.isfinite(out).all()
    assert points.grad is None
    assert torch.equal(out.detach(), planes(torch.tensor([[1.0, -1.0, 0.0]]), 0.3).detach())


def test_smoothness_is_zero_on_flat_planes_only():
    planes = HexPlane(8, 8, 4)
    for plane in planes.space:
        torch.nn.init.constant_(plane, 0.3)
    assert [v.item() for v in planes.smoothness()] == [0, 0, 0]
    with torch.no_grad():
        planes.time[0][0, 1, 2, 3] += 1
    assert all(v.item() > 0 for v in planes.smoothness())


def test_points_that_are_not_numbers_stay_inside_the_planes():
    planes = HexPlane(8, 8, 4)
    out = planes(torch.tensor([[float("nan"), float("inf"), -float("inf")]]), 0.0)
    out.sum().backward()
    assert torch.isfinite(out).all()
