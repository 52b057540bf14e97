"""The presets: what they cost and what they reach."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.events import Event, Step, TrainingProgress
from degense.engine.progress import Progress
from degense.engine.research.bench.child import in_child, peak_memory
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.trainings import psnr_ceiling
from degense.engine.training import TrainConfig

#: What is trained: preset → settings changed. On the CPU `best` would take hours.
PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    "cpu": {"quick": {}, "balanced": {}},
    "cuda": {"quick": {}, "balanced": {}, "best": {}},
}
QUICK_PRESETS = {"quick": {"iterations": 60, "max_gaussians": 2_000}, "balanced": {"iterations": 120, "max_gaussians": 4_000}}
PHANTOMS = {"cpu": PhantomOptions(frames=40, width=320, height=256), "cuda": PhantomOptions(frames=48, width=640, height=512)}
QUICK_PHANTOM = PhantomOptions(frames=12, width=96, height=80)

#: Column key → score of `engine.metrics.evaluate`.
SCORES = {
    "psnr": "psnr_mask",
    "ssim": "ssim",
    "correlation": "displacement_correlation",
    "recovered": "recovered_share",
    "error": "displacement_error",
    "spurious": "spurious_displacement",
    "gaussians": "gaussians",
    "seconds": "train_seconds",
}


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    story = QUICK_PHANTOM if options.quick else PHANTOMS[options.device]
    shape = f"a phantom of {story.frames} frames, {story.width} × {story.height}, seed 0, with exact depth and labels"
    places: list[tuple[Path, str, str, float]] = []
    for name, masked in (("phantom", False), ("phantom-tissue", True)):
        clip = options.scratch / f"presets-{name}"
        if not clip.exists():
            make_phantom(clip, replace(story, tool_masks=masked), lambda fraction, message: progress(0.02 * fraction, message))
        words = f"{shape}, tools masked: neither reconstructed nor scored" if masked else shape
        places.append((clip, name, words, psnr_ceiling(story.noise)))
    for done, (path, name, words, floor) in enumerate(places):

        def tell(fraction: float, message: str, done: int = done) -> None:
            progress(0.02 + 0.98 * (done + fraction) / len(places), message)

        yield _table(path, name, words, floor, options, tell)


def _table(clip: Path, name: str, words: str, floor: float, options: BenchOptions, progress: Progress) -> Table:
    table = Table(
        f"presets-{name}",
        f"Presets on {name.replace('-', ', ')}",
        f"{words[0].upper()}{words[1:]}. Each preset {'cut to a few steps ' * options.quick}is trained with seeds "
        f"{', '.join(map(str, options.seeds))}, each time in a process of its own, as by `degense train`, and scored as by `degense eval`. "
        "Wall: from the start of the process to the saved run. Training: without the start of the program. Memory: on a GPU the most that "
        "tensors held on it, else the most that the process held. mIoU: decoder rnse. "
        f"Shortfall: PSNR below the PSNR ceiling, {floor:.1f} dB.",
        [
            Column("preset", "preset"),
            Column("wall", "wall, s", 1, "mean"),
            Column("seconds", "training, s", 1, "mean"),
            Column("psnr", "PSNR of valid pixels, dB", 2, "mean"),
            Column("short", "shortfall, dB", 2, "mean"),
            Column("ssim", "SSIM", 3, "mean"),
            Column("miou", "mIoU", 3, "mean"),
            Column("correlation", "motion: correlation", 3, "mean"),
            Column("recovered", "recovered share", 3, "mean"),
            Column("error", "mean error, mm", 3, "mean"),
            Column("spurious", "spurious, mm", 3, "mean"),
            Column("gaussians", "Gaussians", 0, "mean"),
            Column("memory", "memory, MB", 0, "mean"),
        ],
        pareto=("seconds", "short"),
    )
    presets = QUICK_PRESETS if options.quick else PRESETS[options.device]
    jobs = [(preset, seed) for preset in presets for seed in options.seeds]
    found: dict[str, list[dict[str, Any]]] = {preset: [] for preset in presets}
    for done, (preset, seed) in enumerate(jobs):

        def tell(fraction: float, message: str, done: int = done, preset: str = preset, seed: int = seed) -> None:
            progress((done + fraction) / len(jobs), f"{name}, {preset}, seed {seed}: {message}")

        config = TrainConfig.preset_of(preset, device=options.device, seed=seed, **presets[preset])
        out = options.scratch / f"presets-run-{preset}-{seed}"
        found[preset].append(in_child(train_and_score, clip, out, config, time.time(), progress=tell))
        shutil.rmtree(out)
    for preset, several in found.items():
        row: dict[str, Cell] = {"preset": preset, "short": [floor - scores["psnr_mask"] for scores in several]}
        for key, score in {**SCORES, "wall": "wall", "memory": "memory", "miou": "miou_rnse"}.items():
            values = [scores.get(score) for scores in several]
            row[key] = [value for value in values if value is not None] or None
        table.rows.append(row)
    return table


def train_and_score(clip_folder: Path, out: Path, config: TrainConfig, started: float, progress: Progress) -> dict[str, Any]:
    """Train and evaluate, in this process.

    The scores of `evaluate` and `wall` (seconds since `started`, a time of the clock), `memory` (MB) and `miou_rnse`, that of the decoder.
    """
    import torch

    from degense.engine.data.readers import open_clip
    from degense.engine.metrics.evaluate import evaluate
    from degense.engine.scene import Scene
    from degense.engine.training import train

    def tell(event: Event) -> None:
        if isinstance(event, Step):
            progress(0.1 * event.fraction, event.message)
        elif isinstance(event, TrainingProgress):
            progress(0.1 + 0.8 * event.iteration / event.iterations, f"{event.iteration:,} of {event.iterations:,} steps")

    clip = open_clip(clip_folder)
    train(clip, out, config, events=tell, stop=lambda: False)
    wall = time.time() - started
    memory = torch.cuda.max_memory_allocated() / 2**20 if config.device == "cuda" else peak_memory()
    scene = Scene.open(out, device=config.device, clip=clip)
    scores = evaluate(scene, clip, lambda fraction, message: progress(0.9 + 0.1 * fraction, message))
    return scores | {"wall": wall, "memory": memory, "miou_rnse": scores["miou"]["rnse"]}
