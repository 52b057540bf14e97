"""A tiny clip, and jobs on it that take seconds."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from degense.app.batch.child import start
from degense.app.batch.folder import BatchFolder
from degense.app.batch.plan import BatchJob, JobOptions
from degense.app.batch.work import do_job
from degense.engine.processes.capacity import thread_environment

#: As settings of a plan; a checkpoint with every report.
TINY = {"preset": "quick", "iterations": 75, "max_gaussians": 200, "device": "cpu"}
SETTINGS = (("semantic_steps", "10"), ("checkpoint_seconds", "0.001"))


@pytest.fixture(scope="session")
def small_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A phantom of 5 frames, 48 × 40."""
    from degense.engine.data.synthetic import PhantomOptions, make_phantom

    folder = tmp_path_factory.mktemp("batch") / "clip"
    make_phantom(folder, PhantomOptions(frames=5, width=48, height=40, seed=3), lambda fraction, message: None)
    return folder


@pytest.fixture
def make_job(small_clip: Path, tmp_path: Path) -> Callable[..., BatchJob]:
    """A job on the tiny clip, or on another."""

    def make_job(name: str = "a", clip: Path = small_clip, **said) -> BatchJob:
        return JobOptions(**{**TINY, "settings": SETTINGS, "scores": False, **said}).job(clip, name, tmp_path)

    return make_job


@pytest.fixture(scope="session")
def trained_once(small_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a batch in which job `a` was trained without an interruption, by a process with one thread."""
    path = tmp_path_factory.mktemp("undisturbed")
    folder = BatchFolder(path / "out")
    [job] = folder.begin([JobOptions(**TINY, settings=SETTINGS, scores=False).job(small_clip, "a", path)])
    process = start(thread_environment(1))
    try:
        answer = process.do({"folder": str(folder.path), "job": job.to_json()}, lambda said: None, lambda: False)
    finally:
        process.close()
    assert answer == {"outcome": "done", "words": ""}
    return folder.path


@pytest.fixture
def trained(trained_once: Path, tmp_path: Path) -> BatchFolder:
    """A copy of that folder."""
    shutil.copytree(trained_once, tmp_path / "out")
    return BatchFolder(tmp_path / "out")


def model(folder: BatchFolder | Path, job: str = "a") -> str:
    """The check sum of a trained model."""
    path = folder.path if isinstance(folder, BatchFolder) else folder
    return hashlib.sha256((path / "runs" / job / "model.safetensors").read_bytes()).hexdigest()


def do(folder: BatchFolder, job: BatchJob, stop: Callable[[], bool] = lambda: False) -> list[str]:
    """Do a job in this process; the stages that were told."""
    told: list[str] = []
    do_job(folder, job, lambda stage, fraction, words: told.append(stage), stop)
    return list(dict.fromkeys(told))


@pytest.fixture
def one_thread():
    """As in the process of a slot: how sums are shared out among threads decides their last bits."""
    from degense.engine.research.bench.timing import threads

    with threads(1):
        yield
