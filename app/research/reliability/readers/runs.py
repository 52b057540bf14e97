"""Runs: opened, drawn and asked, in the window's list, in napari, with their check sums; and masks of prompts that are gone on with."""

from __future__ import annotations

from pathlib import Path

import torch

from degense.app.features.documents.fact_rows import run_facts
from degense.app.features.prompts.segment import write_clip_masks
from degense.app.features.runs.run_summaries import summary, training_answers
from degense.app.interop.napari_reader import get_reader
from degense.app.research.reliability import samples
from degense.app.research.reliability.readers.reader import Reader, under
from degense.engine.errors import DegenseError
from degense.engine.events import read_progress
from degense.engine.progress import finish
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet
from degense.engine.store import Run
from degense.engine.store.checksums import check_checksums, write_checksums
from degense.engine.store.run import LabelSupport
from degense.engine.training.checkpoint import PARTS, load_checkpoint, save_checkpoint

ASKED = PromptSet(("gallbladder",))


def run_readers() -> list[Reader]:
    run = under(_run)
    weights = ("**/run.json", "**/run.json", "**/*.safetensors")
    return [
        Reader("run", run, _use_scene, weights),
        Reader("run in napari", run, _use_napari, weights),
        Reader("run in the list", run, lambda path: (summary(path), training_answers(path)), ("**/*.json", "**/*.jsonl")),
        Reader("metrics.jsonl", run, lambda path: read_progress(path / "metrics.jsonl"), ("**/*.jsonl",)),
        Reader("check sums", _summed, check_checksums, ("**/SHA256SUMS", "**/run.json")),
        Reader("checkpoint", _checkpoint, load_checkpoint),
        Reader("masks gone on with", _masked, _go_on, ("masks/*", "masks/**/*")),
    ]


def _run(folder: Path) -> Path:
    """The sample, with what newer runs keep of their labelled frames."""
    run = Run.open(samples.run(folder))
    known = torch.ones(len(run.load_model()))
    run.save_label_support(LabelSupport(known, known.clone(), [0]))
    return folder


def _use_scene(path: Path) -> None:
    """Open, draw and ask: small, since a picture takes as much memory as it is large."""
    scene = Scene.open(path, device="cpu")
    run_facts(scene)
    camera = scene.camera(0)
    small = camera.scaled(samples.WIDTH / max(camera.width, camera.height))
    scene.render(0, small, ("rgb", "displacement"))
    if scene.has_semantics:
        decode_frame(scene, ASKED, 0, small)


def _use_napari(path: Path) -> None:
    reader = get_reader(str(path))
    if reader is None:
        raise DegenseError("There is no run here.")
    for data, _, _ in reader(str(path)):
        data[len(data) - 1]


def _summed(folder: Path) -> Path:
    write_checksums(_run(folder / "input"))
    return folder / "input"


def _checkpoint(folder: Path) -> Path:
    parts = {part: {"a": torch.ones(4), "disagreement": torch.zeros(())} for part in PARTS}
    save_checkpoint(folder, {**parts, "generator": torch.zeros(16, dtype=torch.uint8), "plain": {"iteration": 7, "rate_scale": 1.0}})
    return folder


def _masked(folder: Path) -> Path:
    _run(folder / "input")
    _go_on(folder)
    return folder


def _go_on(folder: Path) -> None:
    scene = Scene.open(folder / "input", device="cpu")
    finish(write_clip_masks(scene, ASKED, range(2), folder / "masks"))
