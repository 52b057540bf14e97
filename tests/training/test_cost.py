"""The estimate before a training: sane, monotone, in words."""

import json
from dataclasses import replace

import pytest
import torch

from degense.engine import gpu
from degense.engine.errors import DegenseError
from degense.engine.training import config
from degense.engine.training.config import PRESETS, TrainConfig
from degense.engine.training.cost import estimate
from tests.fakes import MemoryClip


def cost(frames=10, width=320, height=256, **changes):
    return estimate(MemoryClip(frames, width, height), replace(TrainConfig.preset_of("balanced", device="cpu"), **changes))


def test_what_it_says():
    result = cost()
    assert set(result) == {"seconds", "memory_mb", "gaussians", "words"}
    assert json.loads(json.dumps(result)) == result
    assert result["gaussians"] == TrainConfig.preset_of("balanced").max_gaussians  # the number that was chosen, and no other beside it
    assert f"{result['gaussians']:,} Gaussians" in result["words"]
    assert "on the processor" in result["words"]
    assert f"about {max(1, round(result['seconds'] / 60))} min" in result["words"]


@pytest.mark.parametrize(
    ("key", "more"),
    [
        ("seconds", {"iterations": 20_000}),
        ("seconds", {"max_gaussians": 200_000}),
        ("seconds", {"width": 640}),
        ("seconds", {"frames": 100}),
        ("memory_mb", {"max_gaussians": 200_000}),
        ("memory_mb", {"width": 640}),
        ("memory_mb", {"frames": 100}),
        ("memory_mb", {"channels": 32}),
        ("memory_mb", {"resolution": 128}),
    ],
)
def test_more_work_costs_more(key, more):
    assert cost(**more)[key] > cost()[key]


def test_a_frame_larger_than_the_working_size_costs_no_more():
    assert cost(width=640, height=512, max_pixels=10_000)["seconds"] == cost(width=320, height=256, max_pixels=10_000)["seconds"]


def test_presets_are_in_order():
    seconds = [estimate(MemoryClip(40, 640, 512), TrainConfig.preset_of(name, device="cpu"))["seconds"] for name in PRESETS]
    assert list(PRESETS) == ["quick", "balanced", "best"]
    assert seconds == sorted(seconds)
    assert seconds[0] < 0.2 * seconds[1]


def test_the_planes_fit_in_the_memory_foretold():
    """Parameters, gradients and Adam's two moments of a real field."""
    from degense.engine.field.hexplane import HexPlane

    config = TrainConfig.preset_of("balanced", device="cpu")
    planes = HexPlane(config.channels, config.resolution, 20, config.levels)
    held = 16 * sum(p.numel() for p in planes.parameters()) / 1e6
    assert cost(frames=40)["memory_mb"] > held
    assert cost(frames=40, max_gaussians=16, max_pixels=16)["memory_mb"] < 4 * held


def test_the_gpu_must_exist(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(DegenseError, match="no CUDA GPU was found"):
        cost(device="cuda")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    for module in (gpu, config):
        monkeypatch.setattr(module, "driver_fault", lambda: "")  # the driver of the imagined GPU works
    assert "on the GPU" in cost(device="auto")["words"]
    assert cost(device="cuda")["seconds"] < cost(device="cpu")["seconds"]
