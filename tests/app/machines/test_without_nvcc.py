"""A machine with a GPU and without the compiler of its kernels: one sentence says what to install, and the processor does all."""

from __future__ import annotations

import logging

import pytest
import torch
from torch.utils import cpp_extension

from degense.app import diagnostics
from degense.app.batch.local import device_of
from degense.app.batch.plan import BatchJob
from degense.app.cli.main import main
from degense.app.features.train.job import TrainingJob
from degense.app.features.train.slots import environment_of
from degense.engine import gpu
from degense.engine.scene import Scene
from degense.engine.training.config import choose_device
from tests.app import installed as on
from tests.app.conftest import RUN_ARGUMENTS

SENTENCE = "install the CUDA toolkit 99.0 (nvcc)"


@pytest.fixture
def no_nvcc(monkeypatch, tmp_path):
    """torch says that there is a GPU; there are neither kernels nor a toolkit."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda index=0: "Imagined GPU")
    monkeypatch.setattr(torch.version, "cuda", "99.0")
    monkeypatch.setattr(cpp_extension, "CUDA_HOME", None)
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path / "extensions"))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(gpu, "driver_fault", lambda: "")  # the driver of the imagined GPU works
    gpu._say_once.cache_clear()


def test_it_is_said_once_and_the_processor_does_it(no_nvcc, trained, caplog):
    with caplog.at_level(logging.WARNING):
        assert choose_device("auto").type == "cpu"
        assert choose_device("auto").type == "cpu"
        scene = Scene.open(trained)
    assert [record.message for record in caplog.records if SENTENCE in record.message] == [gpu.lacking_kernels()]
    assert caplog.text.count("meanwhile the processor does all") == 1
    assert scene.render_rgb(3).max() > 60


def test_a_training_and_its_scores(no_nvcc, tiny_clip, tmp_path, capsys, caplog):
    arguments = [*RUN_ARGUMENTS[:2], "--iterations", "20", "--max-gaussians", "500"]  # the device is chosen by itself
    assert main(["train", str(tiny_clip), "--out", str(tmp_path / "run"), *arguments]) == 0
    assert SENTENCE in caplog.text
    assert main(["train", str(tiny_clip), "--out", str(tmp_path / "other"), *arguments, "--device", "cuda"]) == 2
    assert SENTENCE in capsys.readouterr().err


def test_batches_and_the_doctor(no_nvcc, tmp_path):
    job = TrainingJob(tmp_path, tmp_path / "run")
    assert environment_of(job, 0, 2).get("CUDA_VISIBLE_DEVICES") in (None, "")
    assert device_of([BatchJob("a", job)]) == "cpu"
    finding = diagnostics.CHECKS["gsplat"]()
    assert finding.state == "note"
    assert SENTENCE in finding.text


def test_the_window_says_it_and_works(no_nvcc, opened, idle):
    assert SENTENCE in opened.statusBar().currentMessage()
    opened.session.go_to(5)
    idle()
    assert on.viewer(opened).view.frame == 5


def test_with_a_toolkit_or_compiled_kernels_nothing_is_said(no_nvcc, monkeypatch, tmp_path):
    (tmp_path / "toolkit" / "bin").mkdir(parents=True)
    (tmp_path / "toolkit" / "bin" / "nvcc").touch()
    monkeypatch.setattr(cpp_extension, "CUDA_HOME", str(tmp_path / "toolkit"))
    assert gpu.gpu_usable()
    monkeypatch.setattr(cpp_extension, "CUDA_HOME", None)
    assert not gpu.gpu_usable()
    (tmp_path / "extensions" / "gsplat_cuda").mkdir(parents=True)
    (tmp_path / "extensions" / "gsplat_cuda" / "gsplat_cuda.so").touch()
    assert gpu.gpu_usable()
