"""The paper's own system: what its training shows and freezes, its loss, and `degense train --system` from end to end."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
import torch

from degense.app.cli.main import main
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.research.systems import as_system, training_of
from degense.engine.semantics.teachers import teacher_by_name
from degense.engine.store.files import read_json
from degense.engine.training import TrainConfig
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.losses import angular
from degense.engine.training.preparation import Inputs, build_model
from degense.engine.training.semantic.targets import SemanticTargets
from degense.engine.training.trainer import Trainer
from tests.fakes import MemoryClip

TINY = {"iterations": 20, "max_gaussians": 300, "resolution": 8, "channels": 8, "device": "cpu"}


def trainer_of(config):
    clip = MemoryClip()
    torch.manual_seed(0)
    frames = TrainingFrames(clip, config.max_pixels, torch.device("cpu"))
    semantics = SemanticTargets(teacher_by_name("labels", clip), frames, guided=config.guided, rarity=config.rarity)
    inputs = Inputs(clip, frames, None, "labels", None, semantics)
    return Trainer(build_model(inputs, config), frames, semantics, None, config, lambda event: None)


def test_the_field_is_frozen_while_all_frames_are_drawn_and_learned_after():
    trainer = trainer_of(as_system("degensegs", TrainConfig.preset_of("quick", **TINY)))
    model, drawn = trainer.model, []
    chosen = trainer._next_frame
    trainer._next_frame = lambda semantic: drawn.append(chosen(semantic)) or drawn[-1]
    assert model.kinematics.linear

    def field():
        return {name: value.clone() for name, value in model.state_dict().items() if not name.startswith("canonical")}

    first, latents = field(), model.canonical["semantics"].detach().clone()
    while not trainer.deforms:
        trainer.step()
    assert (trainer.iteration, trainer.config.iterations) == (20, 40)
    assert set(drawn) == set(trainer.frames.clip.train_frames)
    assert all(torch.equal(value, first[name]) for name, value in field().items())
    assert model.canonical["semantics"].shape != latents.shape or not torch.equal(model.canonical["semantics"], latents)
    while trainer.iteration < trainer.config.iterations:
        trainer.step()
    now = field()
    for part in ("planes", "kinematics", "geometry", "semantic"):
        assert any(not torch.equal(value, first[name]) for name, value in now.items() if name.startswith(part)), part
    rates = {group["name"]: group["base"] for group in trainer.optimizer.param_groups}
    assert (rates["planes"], rates["field"], rates["semantic"]) == (1.6e-3, 1.6e-3, 1.6e-3)
    assert set(trainer.report(1)["losses"]) == {"l1", "ssim", "align", "region"}


def test_the_loss_is_equation_3_over_labelled_pixels():
    trainer = trainer_of(as_system("degensegs", TrainConfig.preset_of("quick", **TINY)))
    frame = trainer.semantics.frames[0]
    target = trainer.semantics.target(frame)
    width, height = trainer.frames.size
    latent = torch.from_numpy(np.random.default_rng(0).normal(size=(height, width, target.latents.shape[1]))).float()
    labelled = target.index >= 0
    drawn = latent.double().reshape(-1, latent.shape[2])[labelled].numpy()
    wanted = target.latents[target.index[labelled].long()].double().numpy()
    cosine = (drawn * wanted).sum(1) / np.linalg.norm(drawn, axis=1) / np.linalg.norm(wanted, axis=1)
    assert float(trainer.semantics.loss(latent, frame, angular, 0.0)["align"]) == pytest.approx(float(np.mean(1 - cosine)), abs=1e-5)


def test_what_was_given_by_hand_must_agree_with_the_system():
    config = TrainConfig.preset_of("quick", iterations=30, max_pixels=5000)
    found = training_of("degensegs", config)
    assert (found.iterations, found.coarse_iterations, found.max_pixels) == (60, 30, 5000)
    with pytest.raises(DegenseError, match=r"degensegs is trained with flow 0\.0; leave flow out"):
        training_of("degensegs", TrainConfig.preset_of("quick", flow=3.0))


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("degensegs") / "clip"
    make_phantom(folder, PhantomOptions(frames=9, width=64, height=48, seed=4))
    return folder


def test_it_is_trained_by_name_and_scored_by_its_own_decoder(clip, tmp_path, capsys):
    words = ["--preset", "quick", "--iterations", "10", "--max-gaussians", "300", "--device", "cpu", "--seed", "5"]
    assert main(["train", str(clip), "--out", str(tmp_path / "run"), "--system", "degensegs", *words]) == 0
    config = read_json(tmp_path / "run" / "run.json")["config"]
    assert config == as_system("degensegs", TrainConfig.preset_of("quick")).to_json() | {
        name: config[name] for name in ("given", "seed", "device", "max_gaussians", "iterations", "coarse_iterations")
    }
    assert (config["iterations"], config["coarse_iterations"]) == (20, 10)
    assert main(["eval", str(tmp_path / "run"), "--json", str(tmp_path / "scores.json")]) == 0
    assert 0 <= read_json(tmp_path / "scores.json")["miou"]["rnse-paper"] <= 1
    command = ["segment", str(tmp_path / "run"), "--prompt", "liver", "--frame", "1", "--out", str(tmp_path / "mask.png")]
    assert main([*command, "--decoder", "rnse-paper"]) == 0
    capsys.readouterr()
    assert main(["train", str(clip), "--out", str(tmp_path / "other"), "--system", "nerf", *words]) != 0
    assert "no system 'nerf'" in capsys.readouterr().err


def test_a_plain_training_imports_no_research(clip, tmp_path):
    words = ["train", str(clip), "--out", str(tmp_path / "run"), "--preset", "quick", "--iterations", "2", "--teacher", "none"]
    program = (
        "import json, sys; from degense.app.cli.main import main; code = main(sys.argv[1:]); "
        "print(json.dumps([code, [name for name in sys.modules if name.startswith('degense.engine.research')]]))"
    )
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == [0, []]
