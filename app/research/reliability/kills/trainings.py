"""A training, a batch in one process, and `degense batch` with the processes of its slots: each is gone on with to the end."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from degense.app.cli.main import INTERRUPTED
from degense.app.research.reliability import samples
from degense.app.research.reliability.kills.program import Killed, Program
from degense.app.research.reliability.kills.whole import Expected, check_whole

STEPS = 30
SETTINGS = {"resolution": 8, "channels": 8, "checkpoint_seconds": 0.2, "semantic_steps": 10}
WORDS = (
    *("--preset", "quick", "--iterations", str(STEPS), "--max-gaussians", "300", "--device", "cpu"),
    *(word for name, value in SETTINGS.items() for word in ("--set", f"{name}={value}")),
)
EXPORTS = ("ply", "masks-png")
#: The name of the program that starts a process for each slot.
COMMAND = "batch --slots 2"


def programs() -> list[Program]:
    return [
        Program(
            "train",
            partial(small_run, name="undisturbed"),
            partial(small_run, name="out"),
            _check_run,
            lambda folder: (folder / "out" / "run.json").exists(),
        ),
        Program("batch", _prepare_batch, _batch, _check_batch, _has_jobs),
        Program(COMMAND, _prepare_command, _command, _check_command, _has_jobs, ("SIGKILL", "SIGTERM"), weight=0.5, patience=600.0),
    ]


# -- a training ----------------------------------------------------------------------------------------------------------------------------
def small_run(folder: Path, name: str = "run") -> None:
    """Train a small clip, `folder / "clip"`, into `folder / name`."""
    from degense.app.cli.main import main

    if not (folder / "clip").exists():
        samples.phantom(folder / "clip")
    main(["train", str(folder / "clip"), "--out", str(folder / name), *WORDS, "--events"])


def _check_run(folder: Path, killed: Killed) -> None:
    """It is gone on with, and ends as the undisturbed one."""
    if (folder / "out" / "run.json").exists():
        _finish(folder / "clip", folder / "out")
        _check_same(folder / "out" / "model.safetensors", folder / "undisturbed" / "model.safetensors")


def _finish(clip: Path, path: Path) -> None:
    """Go on with a run to its end, if it is not there yet, and open it."""
    from degense.engine.data.readers import open_clip
    from degense.engine.scene import Scene
    from degense.engine.store import Run
    from degense.engine.training import TrainConfig, train

    state = Run.open(path).info["state"]
    assert state in ("training", "stopped", "finished"), state
    if state != "finished":
        train(open_clip(clip), path, TrainConfig(device="cpu"), resume=True, events=lambda event: None, stop=lambda: False)
    Scene.open(path, device="cpu")


# -- a batch -------------------------------------------------------------------------------------------------------------------------------
def _prepare_batch(folder: Path) -> None:
    samples.phantom(folder / "a")
    _batch(folder)
    (folder / "out").rename(folder / "undisturbed")


def _batch(folder: Path) -> None:
    from degense.app.batch.folder import BatchFolder
    from degense.app.batch.plan import JobOptions
    from degense.app.batch.work import do_job

    settings = tuple((name, str(value)) for name, value in SETTINGS.items())
    said = {"preset": "quick", "iterations": STEPS, "max_gaussians": 300, "device": "cpu", "settings": settings}
    options = JobOptions(**said, prompts=("liver",), exports=EXPORTS, scores=False)  # type: ignore[arg-type]
    batch = BatchFolder(folder / "out")
    [job] = batch.begin([options.job(folder / "a", "a", folder)])
    do_job(batch, job, lambda stage, fraction, words: None, lambda: False)


def _has_jobs(folder: Path) -> bool:
    return (folder / "out" / "batch.json").exists()


def _check_batch(folder: Path, killed: Killed) -> None:
    """What is called done is there and whole; the rest is done when it is called again, and all ends as the undisturbed one."""
    _check_done(folder)
    _batch(folder)
    _check_as_undisturbed(folder)


def _prepare_command(folder: Path) -> None:
    for name in ("a", "b"):
        samples.phantom(folder / name)
    _command(folder)
    (folder / "out").rename(folder / "undisturbed")


def _command(folder: Path) -> None:
    from degense.app.cli.main import main

    asked = ["--no-eval", "--prompt", "liver", *(word for name in EXPORTS for word in ("--export", name))]
    status = main(["batch", str(folder / "a"), str(folder / "b"), "--out", str(folder / "out"), "--slots", "2", *WORDS, *asked])
    assert status in (0, INTERRUPTED), f"the batch ended with {status}"


def _check_command(folder: Path, killed: Killed) -> None:
    """As that of a batch in one process."""
    _check_done(folder)
    _command(folder)
    _check_as_undisturbed(folder)


def _check_done(folder: Path) -> None:
    from degense.app.batch.folder import BatchFolder

    if not _has_jobs(folder):
        return
    batch = BatchFolder(folder / "out")
    for job in batch.jobs():
        for stage in set(job.stages()) - set(batch.left(job)):
            assert batch.product(job, stage).exists(), f"{stage} is called done and is not there"
        for name in job.exports:
            if (product := batch.export(job, name)).exists():
                check_whole(name, product, Expected(samples.SHAPE, samples.FRAMES, samples.FRAMES))


def _check_as_undisturbed(folder: Path) -> None:
    from degense.app.batch.folder import BatchFolder

    batch = BatchFolder(folder / "out")
    assert not [job.name for job in batch.jobs() if batch.left(job)]
    for path in (folder / "undisturbed").glob("exports/**/*"):
        if path.is_file():
            _check_same(folder / "out" / path.relative_to(folder / "undisturbed"), path)


def _check_same(path: Path, undisturbed: Path) -> None:
    assert path.read_bytes() == undisturbed.read_bytes(), f"{path.name} is another than that of an undisturbed one"
