"""A GPU that is gone, whose driver fails after it promised one, or whose memory is full while the window draws."""

from __future__ import annotations

import json
import logging

import numpy as np
import pytest
import torch

from degense.app.cli.main import main
from degense.app.features.viewer import view_rendering
from degense.app.features.viewer.view_rendering import GPU_FULL
from degense.engine import gpu
from degense.engine.data.readers import open_clip
from degense.engine.errors import OUT_OF_MEMORY, DegenseError
from degense.engine.scene import Scene
from degense.engine.scene.renderer import Renderer
from degense.engine.store import Run
from degense.engine.training import TrainConfig, train
from degense.engine.training.config import choose_device
from tests.app import installed as on
from tests.app.conftest import RUN_ARGUMENTS

BROKEN = "CUDA driver initialization failed, you might not have a CUDA gpu.\nMore is in the log of the system."


def fail(*words: object) -> None:
    raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")


@pytest.fixture
def full(monkeypatch, opened):
    """The open scene as one on a GPU that has no memory left to draw."""
    scene, draw = opened.session.scene, Renderer.draw
    moved: list[str] = []

    def drawn(renderer, *words):
        if not moved:
            fail()
        return draw(renderer, *words)

    def move_to(self, device, move=Scene.move_to):
        moved.append(device)
        move(self, device)

    monkeypatch.setattr(Renderer, "draw", drawn)
    monkeypatch.setattr(Scene, "device", property(lambda self: torch.device("cpu" if moved else "cuda")))
    monkeypatch.setattr(Scene, "move_to", move_to)
    scene.renderer.forget()
    return moved


def test_the_window_draws_by_the_processor_and_says_so(full, opened, idle, screenshot):
    before = on.viewer(opened).view
    opened.session.go_to(5)
    idle()
    view = on.viewer(opened).view
    assert (full, view.frame) == (["cpu"], 5)
    assert opened.statusBar().currentMessage() == GPU_FULL
    screenshot(opened, "gpu-full")
    opened.session.go_to(0)
    idle()
    assert on.viewer(opened).view.notice == ""  # said once
    np.testing.assert_array_equal(on.viewer(opened).view.rgb, before.rgb)
    opened.session.view.add_prompt("liver")
    idle()
    assert on.viewer(opened).view.masks.any()


def test_without_memory_anywhere_it_says_so_and_goes_on_when_there_is_some(opened, idle, monkeypatch):
    with monkeypatch.context() as without:
        without.setattr(Renderer, "draw", fail)
        opened.session.go_to(5)
        idle()
        assert on.viewer(opened).panel._message == OUT_OF_MEMORY
    opened.session.go_to(6)
    idle()
    assert on.viewer(opened).view.frame == 6


def test_a_run_that_does_not_fit_the_gpu_opens_on_the_processor(window, run, idle, monkeypatch):
    load = Run.load_model

    def full(self, device, load=load):
        if torch.device(device).type == "cuda":
            fail()
        return load(self, device)

    monkeypatch.setattr("degense.engine.scene.scene.gpu_usable", lambda: True)
    monkeypatch.setattr(Run, "load_model", full)
    on.documents(window).open_path(run)
    idle()
    assert window.session.scene.device.type == "cpu"
    assert on.viewer(window).view.complete


def test_the_3d_view_is_drawn_by_the_processor(opened, monkeypatch):
    request = on.viewer(opened).splats.snapshot_request()
    expected = view_rendering.draw_snapshot(request)

    def snapshot(request, device, draw=view_rendering._snapshot):
        if device == "cuda":
            fail()
        return draw(request, device)

    monkeypatch.setattr(view_rendering, "_device", lambda: "cuda")
    monkeypatch.setattr(view_rendering, "_snapshot", snapshot)
    np.testing.assert_array_equal(view_rendering.draw_snapshot(request), expected)


def test_a_run_of_a_gpu_is_opened_drawn_asked_and_resumed_without_one(tiny_clip, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    run, words = tmp_path / "run", ["train", str(tiny_clip), "--out", str(tmp_path / "run"), *RUN_ARGUMENTS]
    stops = iter(range(10_000))
    config = TrainConfig.preset_of("quick", iterations=60, max_gaussians=1500, device="cpu")
    begun = run / "run.json"
    assert train(open_clip(tiny_clip), run, config, events=lambda event: None, stop=lambda: begun.exists() and next(stops) > 5) is None
    info = json.loads((run / "run.json").read_text(encoding="utf-8"))
    info["config"]["device"], info["hardware"] = "cuda", "NVIDIA H100 80GB HBM3"
    (run / "run.json").write_text(json.dumps(info), encoding="utf-8")
    assert main([*words[:-1], "cuda", "--resume"]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == "degense: no CUDA GPU was found; train with --device cpu, or see degense doctor"
    assert main([*words, "--resume"]) == 0
    info = json.loads((run / "run.json").read_text(encoding="utf-8"))
    info["config"]["device"] = "cuda"
    (run / "run.json").write_text(json.dumps(info), encoding="utf-8")
    assert main(["query", str(run), "liver"]) == 0
    assert main(["render", str(run), "--frame", "2", "--out", str(tmp_path / "frame.png")]) == 0
    assert main(["eval", str(run)]) == 0
    assert Scene.open(run).render_rgb(2).max() > 60


@pytest.fixture
def broken(monkeypatch):
    """torch promises a GPU, and its first use fails."""

    def zeros(*size, device=None, make=torch.zeros, **words):
        if str(device).startswith("cuda"):
            raise RuntimeError(BROKEN)
        return make(*size, device=device, **words)

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(gpu, "kernels_compiled", lambda: True)
    monkeypatch.setattr(torch, "zeros", zeros)
    gpu._say_once.cache_clear()


def test_a_driver_that_fails_after_promising_a_gpu_is_one_sentence(broken, trained, tiny_clip, tmp_path, capsys, caplog):
    with caplog.at_level(logging.WARNING):
        assert Scene.open(trained).render_rgb(3).max() > 60
        assert choose_device("auto").type == "cpu"
    said = [record.message for record in caplog.records if "driver initialization" in record.message]
    assert said == [gpu.driver_fault()]
    assert "\n" not in said[0]
    with pytest.raises(DegenseError, match="driver initialization failed, you might not have a CUDA gpu"):
        choose_device("cuda")
    assert main(["train", str(tiny_clip), "--out", str(tmp_path / "run"), *RUN_ARGUMENTS[:-1], "cuda"]) == 2
    error = capsys.readouterr().err
    assert error.splitlines()[-1] == f"degense: {gpu.driver_fault()}"
    assert "Traceback" not in error
