"""A profile names what a training does, accounts for all of its time, and changes nothing."""

import json
import time

import pytest
import torch

import degense.engine.training.job as training
from degense.app.cli.profile_report import write_profile
from degense.engine.profile import Profile, part, recording, renamed_at_gradient
from degense.engine.store.files import read_tensors
from degense.engine.training import TrainConfig, train
from tests.fakes import MemoryClip

STAGES = {"load", "teacher", "flow", "initialise", "coarse", "joint", "semantics", "save"}
STEP = {"field", "raster", "losses", "losses backward", "raster backward", "field backward", "optimiser", "density"}


def trained(folder):
    config = {"iterations": 20, "max_gaussians": 300, "resolution": 8, "channels": 8, "checkpoint_seconds": 1e9, "device": "cpu"}
    train(MemoryClip(), folder, TrainConfig.preset_of("quick", **config), events=lambda event: None, stop=lambda: False)
    return read_tensors(folder / "model.safetensors")


def test_a_profile_names_the_stages_adds_up_and_changes_no_bit(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "fingerprint", lambda clip: str(clip.path))
    plain = trained(tmp_path / "plain")
    begin = time.perf_counter()
    with recording("cpu") as profile:
        profiled = trained(tmp_path / "profiled")
    wall = time.perf_counter() - begin
    words = write_profile(profile, tmp_path / "profiled")
    found = json.loads((tmp_path / "profiled" / "profile.json").read_text())
    parts = {tuple(entry["part"]): entry for entry in found["parts"]}
    assert {path[0] for path in parts if len(path) == 1} >= STAGES
    assert {path[1] for path in parts if path[:1] == ("joint",) and path[1:]} >= STEP
    assert {path[1] for path in parts if path[:1] == ("semantics",) and path[1:]} >= STEP - {"density"} | {"consensus"}
    assert ("flow", "measure", "decode") in parts
    assert parts["joint", "raster", "kernel blend.blend"]["calls"] == parts["joint", "raster backward"]["calls"] == 16
    assert sum(entry["own"] for entry in found["parts"]) == pytest.approx(wall, rel=0.05)
    assert sum(entry["seconds"] for path, entry in parts.items() if len(path) == 1) > 0.8 * wall
    assert "joint" in words
    assert b"<svg" in (tmp_path / "profiled" / "profile.svg").read_bytes()
    assert plain.keys() == profiled.keys()
    assert all(torch.equal(plain[name], profiled[name]) for name in plain)


def test_parts_within_parts_add_up_and_a_gradient_begins_a_part():
    with recording("cpu") as profile:
        x = torch.ones(3, requires_grad=True)
        middle = x * 2
        renamed_at_gradient(middle, "second")
        with part("outer"), part("first"):
            middle.square().sum().backward()
    assert set(profile.spent) == {(), ("outer",), ("outer", "first"), ("outer", "second")}
    assert profile.within(("outer",)) == pytest.approx(sum(spent.own for path, spent in profile.spent.items() if path))
    assert profile.seconds == pytest.approx(profile.within(()))


def test_nothing_is_timed_unless_it_is_asked_for():
    with part("anything"):
        pass
    assert Profile("cpu").spent.keys() == {()}


@pytest.mark.cuda
def test_on_a_gpu_the_time_of_its_queue_counts():
    values = torch.ones(4000, 4000, device="cuda")
    with recording("cuda") as profile, part("products"):
        for _ in range(20):
            values @ values
    assert profile.within(("products",)) > 0.8 * profile.seconds > 0
