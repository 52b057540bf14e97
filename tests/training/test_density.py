"""Density control: the cap, pruning, splitting, and Adam's moments that follow."""

import pytest
import torch

from engine.training.config import TrainConfig
from engine.training.density import Density, rotate
from engine.training.optimiser import make_optimiser
from tests.field.test_model import make


def prepared(cap, count=60):
    model = make("isolated", count=count)
    optimizer = make_optimiser(model, TrainConfig())
    sum(p.square().sum() for p in model.parameters()).backward()
    optimizer.step()
    density = Density(model, cap)
    density.opacity[:] = 0.5
    density.seen[:] = 1
    return model, optimizer, density


def test_the_cap_holds_and_the_neediest_go_first():
    model, optimizer, density = prepared(cap=65)
    density.gradient[:] = torch.linspace(1e-3, 1e-2, 60)
    expected = model.canonical["colors"].data[-5:].flip(0).clone()
    done = density.step(optimizer, torch.Generator().manual_seed(0))
    assert len(model) == 65
    assert done == {"pruned": 0, "cloned": 5, "split": 0}
    assert torch.equal(model.canonical["colors"].data[60:], expected)


def test_what_was_never_visible_is_pruned_unless_nothing_was():
    model, optimizer, density = prepared(cap=60)
    density.opacity[:30] = 0.001
    survivors = model.canonical["means"].data[30:].clone()
    assert density.step(optimizer, torch.Generator())["pruned"] == 30
    assert torch.equal(model.canonical["means"].data, survivors)
    density.opacity[:] = 0
    assert density.step(optimizer, torch.Generator())["pruned"] == 0
    assert len(model) == 30


def test_large_gaussians_split_into_two_smaller_ones_about_the_same_centre():
    model, optimizer, density = prepared(cap=100)
    density.gradient[7] = 1.0
    density.radius[7] = 50
    before = model.canonical["means"].data[7].clone(), model.canonical["log_scales"].data[7].clone()
    assert density.step(optimizer, torch.Generator().manual_seed(1))["split"] == 1
    means, scales = model.canonical["means"].data[[7, 60]], model.canonical["log_scales"].data[[7, 60]]
    assert torch.allclose(means.mean(0), before[0], atol=1e-6)
    assert torch.allclose(scales, (before[1] - 0.47).expand(2, 3))


def test_adam_keeps_the_moments_of_survivors_and_starts_children_at_zero():
    model, optimizer, density = prepared(cap=100)
    density.opacity[0] = 0
    density.gradient[5] = 1.0
    before = optimizer.state[model.canonical["means"]]["exp_avg"].clone()
    density.step(optimizer, torch.Generator())
    after = optimizer.state[model.canonical["means"]]["exp_avg"]
    assert torch.equal(after[:59], before[1:])
    assert torch.count_nonzero(after[59:]) == 0
    sum(p.square().sum() for p in model.parameters()).backward()
    optimizer.step()
    assert len(optimizer.state) == len(list(model.parameters()))


@pytest.mark.parametrize("seed", [0, 1])
def test_rotate_matches_the_rotation_matrix(seed):
    torch.manual_seed(seed)
    quats, vectors = torch.randn(9, 4, dtype=torch.float64), torch.randn(9, 3, dtype=torch.float64)
    w, x, y, z = torch.nn.functional.normalize(quats, dim=1).T
    matrix = torch.stack(
        [
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        ],
        1,
    ).view(-1, 3, 3)  # fmt: skip
    assert torch.allclose(rotate(quats, vectors), (matrix @ vectors[:, :, None])[..., 0])
