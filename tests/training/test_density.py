"""Density control: the cap, pruning, splitting, and Adam's moments that follow."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.training.config import TrainConfig
from degense.engine.training.density import Density, rotate
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from degense.engine.training.optimiser import make_optimiser
from degense.engine.training.trainer import Trainer
from tests.fakes import MemoryClip
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


def test_visibility_is_remembered_until_the_pruning():
    model, optimizer, density = prepared(cap=80)
    density.opacity[:] = torch.linspace(0.1, 0.6, 60)
    density.opacity[:30] = 0
    density.gradient[[5, 40]] = 1.0
    density.radius[40] = 50
    assert density.step(optimizer, torch.Generator(), prune=False) == {"pruned": 0, "cloned": 1, "split": 1}
    assert len(model) == 62
    before = torch.linspace(0.1, 0.6, 60)
    before[:30] = 0
    assert torch.equal(density.opacity, torch.cat([before, before[[5, 40]]]))
    assert not density.gradient.any()
    assert not density.seen.any()
    density.observe(torch.zeros(62, 2), torch.ones(62), torch.where(torch.arange(62) == 7, 0.3, 0.0), 1.0)
    assert density.step(optimizer, torch.Generator())["pruned"] == 30  # 7 came late; the child of 5 was no more visible than its parent
    assert not density.opacity.any()


def test_what_lives_for_one_frame_of_a_long_clip_is_not_pruned_before_its_turn():
    """One training frame out of 28, and an edit every six steps."""
    clip = MemoryClip(32)
    frames = TrainingFrames(clip, 1 << 20, torch.device("cpu"))
    canonical, bounds = initial_gaussians(frames, None, 200, 0, np.random.default_rng(0))
    persistent = canonical["temporal_windows"][:, 1] == 0
    canonical = {name: value[persistent] for name, value in canonical.items()}
    brief, dead = slice(0, 20), slice(20, 40)
    canonical["temporal_windows"][brief] = torch.tensor([clip.time(17 + 1), 1e4])
    canonical["logits"][dead] = -9.0
    colours = {name: {tuple(c) for c in canonical["colors"][part].tolist()} for name, part in (("brief", brief), ("dead", dead))}
    model = SceneModel(FieldConfig(channels=8, resolution=8, time_resolution=4), bounds, canonical)
    config = replace(
        TrainConfig.preset_of("quick", iterations=1000, device="cpu"),
        densify_every=6,
        coarse_iterations=0,
        rate_color=0.0,
        rate_opacity=0.0,
    )
    trainer = Trainer(model, frames, None, None, config, lambda event: None)

    def left(name):
        return len({tuple(c) for c in model.canonical["colors"].tolist()} & colours[name])

    start = left("brief"), left("dead")
    for _ in range(24):
        trainer.step()
    assert (left("brief"), left("dead")) == start
    for _ in range(36):
        trainer.step()
    assert left("dead") == 0
    assert left("brief") > 0.8 * start[0]


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
    learned = {name for name, parameter in model.named_parameters() if parameter.requires_grad}
    assert learned == {name for name, _ in model.named_parameters()} - {"canonical.temporal_windows"}
    assert len(optimizer.state) == len(learned)


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
