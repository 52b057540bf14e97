"""A small training on a phantom and all its scores: what the benchmarks about learning repeat many times."""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.processes.capacity import trainings_at_once
from degense.engine.progress import Progress
from degense.engine.research import surgeries  # noqa: F401  (adds the kind "family")
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.workers import run_jobs
from degense.engine.research.degraded_teachers import Degradation
from degense.engine.training.config import TrainConfig

#: The kind and the seed of a phantom.
PhantomScene = tuple[str, int]


@dataclass(frozen=True)
class Size:
    """How large the phantoms and the trainings are."""

    frames: int
    width: int
    height: int
    iterations: int
    gaussians: int


#: By device: what a GPU does in minutes takes two processor cores many hours.
SIZES = {"cpu": Size(24, 160, 128, 500, 6000), "cuda": Size(48, 320, 256, 1000, 12_000)}
QUICK = Size(17, 96, 80, 120, 2000)


@dataclass(frozen=True)
class BenchTraining:
    """One training to run and score.

    Attributes
    ----------
    clip, out : Path
        The clip to open, and a folder for the run, which is deleted afterwards.
    config : TrainConfig
    teacher : str
        As `teacher_by_name` knows it, or "none".
    """

    clip: Path
    out: Path
    config: TrainConfig
    teacher: str


def score(training: BenchTraining) -> dict[str, Any]:
    """Train, then everything that `evaluate` says, and `rank` of the latents. Runs in a worker process."""
    from degense.engine.data.readers import open_clip
    from degense.engine.metrics.evaluate import evaluate
    from degense.engine.scene import Scene
    from degense.engine.training import train

    clip = open_clip(training.clip)
    run = train(clip, training.out, training.config, teacher=training.teacher, events=lambda event: None, stop=lambda: False)
    assert run is not None
    scene = Scene.open(training.out, device=training.config.device, clip=clip)
    result = evaluate(scene, clip) | {"rank": scene.basis.rank if scene.basis is not None else 0}
    shutil.rmtree(training.out)
    return result


def size_of(options: BenchOptions) -> Size:
    return QUICK if options.quick else SIZES[options.device]


def phantoms(options: BenchOptions, progress: Progress, scenes: Sequence[PhantomScene]) -> dict[str, Path]:
    """A clip of each scene by its kind, and its seed where that is not 0; made once in the scratch folder."""
    size, found = size_of(options), {}
    for number, (kind, seed) in enumerate(scenes):
        clip = options.scratch / f"{kind}-{seed}-{size.frames}-{size.width}x{size.height}"
        if not clip.exists():

            def tell(fraction: float, words: str, n: int = number) -> None:
                progress((n + fraction) / len(scenes), words)

            make_phantom(clip, PhantomOptions(frames=size.frames, width=size.width, height=size.height, seed=seed, kind=kind), tell)
        found[f"{kind} {seed}" if seed else kind] = clip
    return found


def base_config(options: BenchOptions, **changes: Any) -> TrainConfig:
    """What all trainings of a benchmark have in common, with `changes`."""
    size = size_of(options)
    common = {"device": options.device, "iterations": size.iterations, "max_gaussians": size.gaussians, "checkpoint_seconds": 1e9}
    return TrainConfig.preset_of("quick", **(common | changes))


def vlm_like(seed: int) -> str:
    """The teacher of a training seed: exact labels degraded to blurred features, by chances of its own."""
    return f"degraded:{Degradation(seed=seed)}"


#: `vlm_like` for the words above a table.
TEACHER_WORDS = (
    f"Teacher: exact labels degraded like a VLM ({str(Degradation()).rpartition(',')[0]}; engine/research/degraded_teachers.py) with the "
    "training's seed, training frames only"
)


def score_all(trainings: list[BenchTraining], options: BenchOptions, progress: Progress, words: str) -> list[dict[str, Any]]:
    """Scores of all trainings, in their order."""
    found: dict[int, dict[str, Any]] = dict(run_jobs(score, trainings, trainings_at_once(options.device), progress, words))
    return [found[number] for number in range(len(trainings))]


def psnr_ceiling(noise: float) -> float:
    """PSNR of a perfect picture against frames with sensor noise of that standard deviation (grey levels), both rounded to 8 bits, dB."""
    return 10 * math.log10(255**2 / (noise**2 + 2 / 12))
