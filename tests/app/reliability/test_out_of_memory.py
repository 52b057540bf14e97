"""A GPU whose memory is full: what the user reads, and that the training goes on. torch's error is raised on the CPU."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
import torch

from degense.app.batch.folder import BatchFolder
from degense.app.batch.plan import JobOptions
from degense.app.batch.work import do_job
from degense.app.cli.main import main
from degense.engine.errors import OUT_OF_MEMORY, DegenseError
from degense.engine.research.bench.timing import threads
from degense.engine.store import Run
from degense.engine.training.trainer import Trainer

FULL_AT = 60  # iterations, of 75
SETTINGS = {"semantic_steps": "10", "checkpoint_seconds": "0.001"}
WORDS = ["--preset", "quick", "--iterations", "75", "--max-gaussians", "200", "--device", "cpu"]
WORDS += [word for name, value in SETTINGS.items() for word in ("--set", f"{name}={value}")]


@pytest.fixture
def clip(tmp_path) -> Path:
    assert main(["phantom", str(tmp_path / "clip"), "--frames", "5", "--size", "48x40", "--seed", "3"]) == 0
    return tmp_path / "clip"


@pytest.fixture
def full(monkeypatch) -> list[int]:
    """From now on torch says at one iteration that the GPU is full; the iterations that were begun before and since."""
    begun: list[int] = []

    def step(trainer, step=Trainer.step):
        begun.append(trainer.iteration)
        if trainer.iteration == FULL_AT:
            raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB. GPU 0 has a total capacity of 23.64 GiB.")
        step(trainer)

    monkeypatch.setattr(Trainer, "step", step)
    return begun


def model(run: Path) -> str:
    return hashlib.sha256((run / "model.safetensors").read_bytes()).hexdigest()


def test_a_training_says_what_to_lower_and_is_resumed_to_the_same_bits(clip, tmp_path, full, monkeypatch, capsys):
    run, undisturbed = tmp_path / "run", tmp_path / "undisturbed"
    capsys.readouterr()
    with threads(1):
        assert main(["train", str(clip), "--out", str(run), *WORDS]) == 2
        assert capsys.readouterr().err.splitlines()[-1] == f"degense: {OUT_OF_MEMORY}"
        for way in ("close other programs", "lower --max-gaussians", "take --preset quick", "compute with --device cpu"):
            assert way in OUT_OF_MEMORY
        assert Run.open(run).info["state"] != "finished"
        assert full[-1] == FULL_AT
        monkeypatch.undo()  # there is memory again
        begun: list[int] = []
        with monkeypatch.context() as heard:
            heard.setattr(Trainer, "step", lambda trainer, step=Trainer.step: (begun.append(trainer.iteration), step(trainer))[1])
            assert main(["train", str(clip), "--out", str(run), *WORDS, "--resume"]) == 0
        assert 0 < begun[0] <= FULL_AT  # from a checkpoint
        assert Run.open(run).info["state"] == "finished"
        assert main(["train", str(clip), "--out", str(undisturbed), *WORDS]) == 0
    assert model(run) == model(undisturbed)


def test_a_job_of_a_batch_says_what_to_lower_and_is_gone_on_with(clip, tmp_path, full, monkeypatch):
    folder = BatchFolder(tmp_path / "out")
    small = {"preset": "quick", "iterations": 75, "max_gaussians": 200, "device": "cpu"}
    [job] = folder.begin([JobOptions(**small, settings=tuple(SETTINGS.items()), scores=False).job(clip, "a", tmp_path)])
    with pytest.raises(DegenseError, match=r"^There is not enough memory; take fewer --slots or a smaller preset\.$"):
        do_job(folder, job, lambda stage, fraction, words: None, lambda: False)
    assert "take fewer --slots" in folder.record(job).failure
    monkeypatch.undo()
    do_job(folder, job, lambda stage, fraction, words: None, lambda: False)
    assert folder.left(job) == []
    assert folder.record(job).failure == ""
