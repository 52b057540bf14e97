"""Each system is what its docstring says: looked at in what a short training leaves behind, and in where its gradients go."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import degense.engine.training.job as job
from degense.engine.errors import DegenseError
from degense.engine.research import codebook
from degense.engine.research.codebook import separation, two_levels
from degense.engine.research.systems import SYSTEMS, as_system, words_of
from degense.engine.scene import Scene
from degense.engine.store.migrations import current_settings
from degense.engine.training import TrainConfig, train
from degense.engine.training import trainer as trainer_module
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from tests.fakes import MemoryClip

TINY = {"iterations": 40, "max_gaussians": 400, "resolution": 8, "channels": 8, "device": "cpu", "semantic_steps": 20}


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """A scene of each system, trained for a moment on a square that slides over a wall."""
    folder, patch = tmp_path_factory.mktemp("systems"), pytest.MonkeyPatch()
    patch.setattr(job, "fingerprint", lambda clip: str(clip.path))
    patch.setattr(codebook, "CODES", (6, 3))
    clip, found = MemoryClip(), {}
    for name in SYSTEMS:
        config = as_system(name, TrainConfig.preset_of("quick", **TINY))
        assert train(clip, folder / name, config, events=lambda event: None, stop=lambda: False) is not None
        found[name] = Scene.open(folder / name, device="cpu", clip=clip)
    patch.undo()
    return found


def states(scene):
    return [scene.model.at(t).splats for t in (-1.0, -0.3, 0.4, 1.0)]


@pytest.mark.parametrize("name", ["langsplat", "opengaussian"])
def test_static_scenes_are_the_same_at_all_times(scenes, name):
    first, *later = states(scenes[name])
    for state in later:
        for part in vars(first):
            assert torch.equal(getattr(first, part), getattr(state, part)), part
    assert torch.count_nonzero(scenes[name].states.displacement(9)) == 0
    assert np.array_equal(scenes[name].render_rgb(2), scenes[name].render_rgb(7))


@pytest.mark.parametrize("name", ["dgd", "fe4dgs", "surgtpgs", "degensegs", "degense"])
def test_the_others_move(scenes, name):
    assert scenes[name].states.displacement(9).max() > 0


@pytest.mark.parametrize("name", ["dgd", "fe4dgs", "langsplat", "opengaussian"])
def test_features_of_the_canonical_gaussians_never_change(scenes, name):
    first, *later = states(scenes[name])
    assert all(torch.equal(first.semantics, state.semantics) for state in later)


@pytest.mark.parametrize("name", ["surgtpgs", "degensegs", "degense"])
def test_features_of_the_others_do(scenes, name):
    first, last = (states(scenes[name])[k].semantics for k in (0, -1))
    assert not torch.equal(first, last)


def test_colours_change_in_place_with_degense_only(scenes):
    for name, scene in scenes.items():
        first, last = (states(scene)[k].colors for k in (0, -1))
        assert torch.equal(first, last) is (name != "degense"), name


def test_no_gaussian_of_a_peer_comes_or_goes(scenes):
    frames = TrainingFrames(MemoryClip(), 10_000, torch.device("cpu"))
    first, _ = initial_gaussians(frames, None, 400, 0, np.random.default_rng(0))
    assert torch.count_nonzero(first["temporal_windows"][:, 1]) > 0, (
        "without flow, what moves would begin as Gaussians that live for a moment"
    )
    for name, scene in scenes.items():
        assert name == "degense" or torch.count_nonzero(scene.model.canonical["temporal_windows"][:, 1]) == 0, name


def test_opengaussian_has_no_more_meanings_than_codes(scenes):
    directions = {name: len(torch.unique(scenes[name].model.canonical["semantics"], dim=0)) for name in ("opengaussian", "langsplat")}
    assert directions["opengaussian"] <= 6 * 3 < directions["langsplat"]


@pytest.mark.parametrize(
    ("name", "moves"), [("surgtpgs", True), ("degensegs", True), ("fe4dgs", True), ("dgd", False), ("langsplat", False), ("degense", False)]
)
def test_whether_the_semantic_loss_moves_geometry(monkeypatch, tmp_path, name, moves):
    """In a real step of training: the gradient of L_sem alone by the canonical means and by Ψ_geo, zero also where there is none."""
    found = []
    real = trainer_module.Trainer._semantic_loss

    def watched(self, index):
        loss = real(self, index)
        asked = [self.model.canonical["means"], *self.model.geometry.parameters()]
        gradients = torch.autograd.grad(loss.total, asked, retain_graph=True, allow_unused=True)
        found.append(any(g is not None and bool(g.any()) for g in gradients))
        return loss

    monkeypatch.setattr(trainer_module.Trainer, "_semantic_loss", watched)
    monkeypatch.setattr(job, "fingerprint", lambda clip: str(clip.path))
    config = as_system(name, TrainConfig.preset_of("quick", **(TINY | {"iterations": 12, "semantic_steps": 2})))
    assert train(MemoryClip(), tmp_path / "run", config, events=lambda event: None, stop=lambda: False) is not None
    assert any(found) is moves


def test_budgets_are_the_same():
    config = TrainConfig.preset_of("quick")
    chosen = {name: as_system(name, config) for name in SYSTEMS}
    assert {c.iterations for name, c in chosen.items() if name != "degensegs"} == {config.iterations}
    shared = ("max_gaussians", "max_pixels", "resolution", "levels", "channels", "seed", "max_rank")
    for key in shared:
        assert len({getattr(c, key) for c in chosen.values()}) == 1, key
    assert chosen["degense"] == config
    assert all(c.flow == 0 for name, c in chosen.items() if name != "degense")
    assert all("Kept" in words_of(name) and "Not kept" in words_of(name) for name in SYSTEMS if name != "degense")


def test_runs_with_the_codebook_of_an_earlier_version_go_on_with_clusters():
    old = {name: value for name, value in TrainConfig().to_json().items() if name not in ("distillation", "linear_states", "rarity")}
    assert TrainConfig.from_json(current_settings(old | {"codebook": True})).distillation == "clusters"
    assert TrainConfig.from_json(current_settings(old | {"codebook": False})) == TrainConfig()


def test_an_unknown_system_is_named():
    with pytest.raises(DegenseError, match=r"'nerf'.*langsplat"):
        as_system("nerf", TrainConfig())


def test_separation_by_hand():
    features = torch.tensor([[0.0, 0.0], [2.0, 0.0], [1.0, 3.0], [9.0, 9.0]])
    # segment 0: mean (1, 0), squared distances 1 and 1; segment 1: a single pixel; the last pixel has none. Means are 3 apart.
    expected = 2 / 3 + 0.01 / 9.01
    assert float(separation(features, torch.tensor([0, 0, 1, -1]))) == pytest.approx(expected, abs=1e-6)
    assert float(separation(features[:2], torch.tensor([0, 0]))) == pytest.approx(1.0)


def test_two_levels_keep_apart_what_is_apart():
    random = np.random.default_rng(0)
    features = np.repeat(np.eye(3), 40, axis=0) + random.normal(0, 0.01, (120, 3))
    places = np.repeat([[0.0, 0, 0], [0, 0, 0], [5, 0, 0]], 40, axis=0) + random.normal(0, 0.1, (120, 3))
    clusters = two_levels(features, places, (3, 2), seed=0)
    assert set(clusters) == set(range(clusters.max() + 1))
    assert clusters.max() < 6
    for code in set(clusters):
        assert len(set(np.flatnonzero(clusters == code) // 40)) == 1
    assert list(two_levels(features[:2], places[:2], (64, 5), seed=0)) == [0, 1]
