"""How fast a scene is looked at and asked on this machine: `python -m engine.bench.viewing`.

The scene is the first state of a training on a phantom: 30,000 Gaussians at 640 × 512, each with the latent of the class it lies on.
How well it was trained would change these times only through how far the Gaussians overlap.
"""

from __future__ import annotations

import os
import platform
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from engine.field import FieldConfig, SceneModel
from engine.language.teachers import LabelTeacher, teacher_by_name
from engine.masks import MaskQuery
from engine.phantom import PhantomOptions, make_phantom
from engine.progress import silent
from engine.readers import open_clip
from engine.scene import Scene
from engine.store import Run
from engine.training.frames import TrainingFrames
from engine.training.initialise import initial_gaussians
from engine.training.semantics import SemanticTargets

GAUSSIANS, WIDTH, HEIGHT, FRAMES = 30_000, 640, 512, 9
REPEATS = 15


def make_scene(folder: Path) -> Scene:
    """An untrained scene of exactly `GAUSSIANS` Gaussians, written and opened as a run."""
    make_phantom(folder / "clip", PhantomOptions(frames=FRAMES, width=WIDTH, height=HEIGHT), silent)
    clip = open_clip(folder / "clip")
    frames = TrainingFrames(clip, 1 << 30, torch.device("cpu"))
    teacher = teacher_by_name("labels", clip)
    assert isinstance(teacher, LabelTeacher)
    semantics = SemanticTargets(teacher, frames)
    canonical, bounds = initial_gaussians(frames, None, 2 * GAUSSIANS, semantics.basis.rank, np.random.default_rng(0))
    canonical = {name: value[:GAUSSIANS].clone() for name, value in canonical.items()}
    pixels, _ = frames.cameras[0].project(canonical["means"].double().numpy())
    labels = clip.labels(0)
    assert labels is not None
    column, row = np.clip(pixels.astype(int), 0, [WIDTH - 1, HEIGHT - 1]).T
    canonical["semantics"] = torch.from_numpy(semantics.basis.project(teacher.vectors)[labels[row, column]])
    field = FieldConfig(rank=semantics.basis.rank)
    info = {
        "clip": {"path": "../clip", "name": clip.name, "fingerprint": ""},
        "config": {},
        "field": field.to_json(),
        "unit": frames.unit,
        "reference_frame": 0,
        "encoder": teacher.encoder.name,
    }
    run = Run.create(folder / "run", clip, info)
    run.save_basis(semantics.basis)
    run.save_model(SceneModel(field, bounds, canonical))
    return Scene.open(folder / "run", device="cpu", clip=clip)


def median_ms(work: Callable[[int], object]) -> float:
    """Median wall time of `work(i)` over `REPEATS` calls after one that is not counted."""
    work(0)
    seconds = []
    for i in range(REPEATS):
        start = time.perf_counter()
        work(i)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds) * 1e3


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        scene = make_scene(Path(folder))
        vectors = scene.vectors(scene.classes)
        for i in range(FRAMES):
            scene.splats(i)
        queries: list[MaskQuery] = []

        def first_prompt(i: int) -> None:
            queries.append(scene.new_query(i % FRAMES, scene.camera(i % FRAMES)))
            queries[-1].mask(vectors[0], negatives=vectors)

        rows = [
            ("field of one frame, not yet baked", median_ms(lambda i: scene.model.at(scene.time(i % FRAMES)))),
            ("rgb frame from baked state, float", median_ms(lambda i: scene.draw(i % FRAMES, scene.camera(0), ("rgb",)))),
            ("first prompt on a new frame, drawing included, to mask", median_ms(first_prompt)),
            ("another prompt on that frame, to mask", median_ms(lambda i: queries[i].mask(vectors[1], negatives=vectors[:0]))),
            ("another prompt, all other classes competing", median_ms(lambda i: queries[i].mask(vectors[2], negatives=vectors))),
            ("another threshold", median_ms(lambda i: queries[0].mask(vectors[1], threshold=0.3 + 0.01 * i))),
        ]
    print(f"{platform.machine()}, {os.cpu_count()} cores; {GAUSSIANS:,} Gaussians, {WIDTH} × {HEIGHT}; median of {REPEATS}\n")
    print("| what | ms | a second |\n|---|---|---|")
    for what, milliseconds in rows:
        print(f"| {what} | {milliseconds:.1f} | {1000 / milliseconds:.0f} |")


if __name__ == "__main__":
    main()
