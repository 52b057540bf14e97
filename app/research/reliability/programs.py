"""What is killed: programs that write, each with the check of what they leave."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from degense.app.research.reliability import samples
from degense.app.research.reliability.readers import opened_session
from degense.engine.progress import finish

STEPS = 30
#: Seconds of painting that a power cut may take.
ALLOWED = 2.0
EXPORTS = ("ply", "spz", "gltf", "coco", "label-studio", "nifti", "masks-png", "ply-sequence")


@dataclass(frozen=True)
class Killed:
    """What a check is told: when it ended (seconds of the monotonic clock), and whether the power failed."""

    moment: float
    power: bool


@dataclass(frozen=True)
class Program:
    """`prepare(folder)` makes what it needs, once; `work(folder)` writes into `folder / "out"`; `check(folder, killed)` raises for what is
    lost, AssertionError in words or whatever a reader says."""

    name: str
    prepare: Callable[[Path], None]
    work: Callable[[Path], None]
    check: Callable[[Path, Killed], None]


def programs() -> list[Program]:
    """Those of the campaign."""
    return [
        Program("train", _phantom, _train, _check_run),
        Program("batch", _phantom, _batch, _check_batch),
        Program("annotate", lambda folder: None, _annotate, _check_annotations),
        Program("export", _sample_run, _export, _check_exports),
        Program("index", _sample_run, _index, _check_index),
    ]


def _phantom(folder: Path) -> None:
    samples.phantom(folder / "clip")


def _sample_run(folder: Path) -> None:
    samples.run(folder / "run")


# -- a training ----------------------------------------------------------------------------------------------------------------------------
def _settings() -> list[str]:
    small = {"resolution": 8, "channels": 8, "checkpoint_seconds": 0.2, "semantic_steps": 10}
    return [word for name, value in small.items() for word in ("--set", f"{name}={value}")]


def _train(folder: Path) -> None:
    from degense.app.cli.main import main

    words = ["--preset", "quick", "--iterations", str(STEPS), "--max-gaussians", "300", "--device", "cpu", "--events"]
    main(["train", str(folder / "clip"), "--out", str(folder / "out"), *words, *_settings()])


def _check_run(folder: Path, killed: Killed) -> None:
    _whole_run(folder / "out")


def _whole_run(path: Path) -> None:
    """A run that opens, or says why not; a checkpoint, where one is named, that can be gone on from."""
    from degense.engine.scene import Scene
    from degense.engine.store import Run
    from degense.engine.training.checkpoint import load_checkpoint

    if not (path / "run.json").exists():
        return  # it is begun again
    run = Run.open(path)
    if (path / "checkpoints" / "last.json").exists():
        load_checkpoint(path / "checkpoints")
    assert run.info["state"] in ("training", "stopped", "finished"), run.info["state"]
    if run.info["state"] == "finished":
        Scene.open(path, device="cpu")


# -- a batch -------------------------------------------------------------------------------------------------------------------------------
def _batch(folder: Path) -> None:
    from degense.app.batch.folder import BatchFolder
    from degense.app.batch.plan import JobOptions
    from degense.app.batch.work import do_job

    settings = (("semantic_steps", "10"), ("checkpoint_seconds", "0.2"), ("resolution", "8"), ("channels", "8"))
    said = {"preset": "quick", "iterations": STEPS, "max_gaussians": 300, "device": "cpu", "settings": settings}
    options = JobOptions(**said, prompts=("liver",), exports=("ply", "masks-png"), scores=False)  # type: ignore[arg-type]
    batch = BatchFolder(folder / "out")
    [job] = batch.begin([options.job(folder / "clip", "a", folder)])
    do_job(batch, job, lambda stage, fraction, words: None, lambda: False)


def _check_batch(folder: Path, killed: Killed) -> None:
    """What is called done is there and whole; the rest is left to do."""
    from degense.app.batch.folder import BatchFolder

    if not (folder / "out" / "batch.json").exists():
        return  # not begun
    batch = BatchFolder(folder / "out")
    [job] = batch.jobs()
    batch.record(job)
    for stage in set(job.stages()) - set(batch.left(job)):
        assert batch.product(job, stage).exists(), f"{stage} is called done and is not there"
    _whole_run(batch.run(job))
    for name in job.exports:
        if (product := batch.export(job, name)).exists():
            _whole_export(product)


# -- painting ------------------------------------------------------------------------------------------------------------------------------
def _annotate(folder: Path) -> None:
    """A stroke of one pixel every 20 ms, a tick every second and a save every five, as the window does; told outside when it is done."""
    from degense.engine.annotation.painting import PixelRegion

    (folder / "out").mkdir(exist_ok=True)
    session, annotations = opened_session(folder / "out")
    said = os.open(folder / "strokes", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    begin = time.monotonic()
    ticks = 0
    for stroke in range(samples.WIDTH * samples.HEIGHT):
        row, column = divmod(stroke, samples.WIDTH)
        annotations.paint("Brush", PixelRegion(row, column, np.ones((1, 1), bool)), 1)
        os.write(said, f"{time.monotonic()}\n".encode())
        if time.monotonic() - begin > ticks + 1:
            ticks += 1
            session.store.write_pending()
            if ticks % 5 == 0:
                session.save()
        time.sleep(0.02)


def _check_annotations(folder: Path, killed: Killed) -> None:
    """Every stroke that was told is there; after a power cut those of the last two seconds may be lost."""
    log = folder / "strokes"
    told = [float(line) for line in log.read_text(encoding="ascii").split()] if log.exists() else []
    safe = sum(at < killed.moment - (ALLOWED if killed.power else 0.0) for at in told)
    (folder / "out").mkdir(exist_ok=True)
    session, annotations = opened_session(folder / "out")
    if session.store.unsaved:
        session.recover()
    found = int((annotations.labels(0) == 1).sum())
    session.close()
    assert found >= safe, f"{found} of {safe} strokes are left, {len(told)} were made"


# -- exports -------------------------------------------------------------------------------------------------------------------------------
def _export(folder: Path) -> None:
    from degense.app.features.export.formats import FORMATS, ExportOptions
    from degense.engine.scene import Scene
    from degense.engine.semantics.prompts import PromptSet

    scene, prompts = Scene.open(folder / "run", device="cpu"), PromptSet.chosen(["liver"], None, None)
    (folder / "out").mkdir(exist_ok=True)
    for number in range(100):
        for name in EXPORTS:
            out = folder / "out" / f"{number}-{name}{FORMATS[name].suffix}"
            finish(FORMATS[name].export(scene, out, ExportOptions(prompts, frames=range(2), source="masks")))


def _check_exports(folder: Path, killed: Killed) -> None:
    for path in (folder / "out").iterdir() if (folder / "out").exists() else ():
        if not path.name.startswith("."):
            _whole_export(path)


def _whole_export(path: Path) -> None:
    """Everything under its final name is whole, by what its format says of its end."""
    for file in [path] if path.is_file() else [child for child in path.rglob("*") if child.is_file() and not child.name.startswith(".")]:
        data = file.read_bytes()
        if file.suffix == ".ply":
            end = data.index(b"end_header\n") + len(b"end_header\n")
            count = int(data[:end].split(b"element vertex ")[1].split()[0])
            sound = len(data) - end == count * 4 * data[:end].count(b"property float")
        elif file.suffix == ".json":
            sound = json.loads(data) is not None
        elif file.suffix == ".png":
            sound = b"IEND" in data[-12:]
        elif file.suffix == ".glb":
            sound = int.from_bytes(data[8:12], "little") == len(data)
        elif file.suffix in (".gz", ".spz"):
            import gzip

            sound = bool(gzip.decompress(data))
        else:
            sound = bool(data)
        assert sound, f"{file.name} is half written, under its final name"


# -- the index of an archive ---------------------------------------------------------------------------------------------------------------
def _index(folder: Path) -> None:
    from degense.engine.archive.index_file import INDEX
    from degense.engine.archive.indexing import update_index

    (folder / "out").mkdir(exist_ok=True)
    link = folder / "out" / "one"
    if not link.exists():
        samples.run(link)
    while True:
        finish(update_index(folder / "out"))
        (folder / "out" / INDEX).unlink()


def _check_index(folder: Path, killed: Killed) -> None:
    """It can be read, and written on."""
    from degense.engine.archive.index_file import INDEX, open_index

    if (folder / "out" / INDEX).exists():
        for write in (False, True):
            with open_index(folder / "out" / INDEX, write) as index:
                assert not [run.error for run in index.runs() if run.error]
