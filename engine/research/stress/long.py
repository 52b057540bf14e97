"""Long clips and long trainings: memory that stays bounded, numbers that stay finite, the same seed and the same run."""

from __future__ import annotations

import shutil
import time
from functools import partial
from pathlib import Path

import torch

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.events import Event, Rollback, TrainingProgress
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.child import call_in_child, peak_memory
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Table
from degense.engine.research.stress.clip_cases import clip_cases
from degense.engine.research.stress.long_clips import PICTURES, write_pictures, write_video
from degense.engine.research.stress.outcome import COLUMNS, StressFinding, non_finite, row
from degense.engine.store.files import read_tensors
from degense.engine.training import TrainConfig, train

FRAMES = 2000
OPENED, STEPPED, SMALL = (640, 512), (320, 256), (96, 80)  # pixels; quick takes the small one for both
OPENING_MB, STEPS_MB = 1024, 4096  # the second: 1.5 GB of frames, .75 GB each of supervision and of flow, and the libraries
ITERATIONS, QUICK_ITERATIONS = 30_000, 400
TWICE_FRAMES, TWICE_STEPS = 12, 60


def table(options: BenchOptions, progress: Progress = silent) -> Table:
    """Everything that takes long."""
    opened, stepped = (SMALL, SMALL) if options.quick else (OPENED, STEPPED)
    frames = FRAMES // 4 if options.quick else FRAMES
    iterations = QUICK_ITERATIONS if options.quick else ITERATIONS
    folder = options.scratch / "long"
    work = {
        f"open {_words(FRAMES, opened)}, pictures with masks, labels and depth": partial(opening_finding, folder / "clip", opened),
        f"open {_words(FRAMES, opened)}, a video": partial(opening_finding, folder / "video.mp4", opened),
        f"10 steps on {_words(frames, stepped)}": partial(steps_finding, folder, stepped, frames, options.device),
        f"10 steps on {_words(frames // 4, stepped)}": partial(steps_finding, folder, stepped, frames // 4, options.device),
        f"{iterations:,} iterations": partial(long_finding, folder, iterations, options.device),
        f"the same seed twice, {_words(TWICE_FRAMES, stepped)}": partial(twice_finding, folder, stepped, options.device),
        "stopped and resumed": partial(resumed_finding, folder, options.device),
    }
    rows = []
    for i, (name, finding) in enumerate(work.items()):
        progress(i / len(work), name)
        try:
            rows.append(row(name, finding, str(folder)))
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    return Table(
        "stress-long",
        "Long clips and long trainings",
        f"Opening: every {FRAMES // 50}th frame is then read with its validity, depth and labels; allowed are {OPENING_MB:,} MB. Steps "
        f"on a long clip: preset quick, optical flow and teacher included, on a clip that repeats {PICTURES} pictures; allowed are "
        f"{STEPS_MB:,} MB. Each in a process of its own, whose peak memory is given, interpreter and libraries included. Iterations: a "
        "phantom of 12 frames of 64 × 48 pixels, 400 Gaussians; all numbers of the model and of the log are counted. Same "
        f"seed: {TWICE_STEPS} steps of preset quick and as many of distillation, optical flow and a teacher's patches included; sums are "
        "shared out over threads only where there are many. Resumed: 300 steps of the small phantom, stopped half way. The error is the "
        "largest difference of a number of the model, which must be 0 on the CPU.",
        [column for column in COLUMNS if column.key != "gradient"],
        rows,
    )


def _words(frames: int, size: tuple[int, int]) -> str:
    return f"{frames:,} frames of {size[0]} × {size[1]}"


def opening_finding(path: Path, size: tuple[int, int]) -> StressFinding:
    """Open a long clip."""
    (write_video if path.suffix else write_pictures)(path, FRAMES, *size)
    seconds, memory, bad = call_in_child(open_and_read, path)
    return StressFinding(bad, within(memory, OPENING_MB), memory=memory, seconds=seconds)


def within(memory: float | None, limit: float) -> str:
    """The outcome of a case that may take so many MB."""
    return "ok" if memory is None or memory <= limit else f"MORE THAN {limit:,.0f} MB"


def open_and_read(path: Path) -> tuple[float, float | None, int]:
    """Seconds of opening, MB, and non-finite depths."""
    begin = time.perf_counter()
    clip = open_clip(path)
    seconds, bad = time.perf_counter() - begin, 0
    for i in range(0, len(clip), 40):
        clip.frame(i), clip.valid(i), clip.labels(i)
        bad += non_finite(clip.depth(i))
    return seconds, peak_memory(), bad


def steps_finding(folder: Path, size: tuple[int, int], frames: int, device: str) -> StressFinding:
    """A few steps on a long clip."""
    write_pictures(folder / "clip", frames, *size)
    seconds, memory, bad = call_in_child(few_steps, folder, device)
    return StressFinding(bad, within(memory, STEPS_MB), memory=memory, seconds=seconds)


def few_steps(folder: Path, device: str) -> tuple[float, float | None, int]:
    """Seconds of everything, MB, and non-finite numbers of the model."""
    begin = time.perf_counter()
    config = TrainConfig.preset_of("quick", iterations=10, device=device)
    bad = non_finite(trained(folder, folder / "run", config))
    return time.perf_counter() - begin, peak_memory(), bad


def trained(folder: Path, out: Path, config: TrainConfig, halt: int | None = None, teacher: str | None = None) -> dict[str, torch.Tensor]:
    """Tensors of the model that `folder`/clip gives; with `halt` the training is stopped there and resumed."""
    clip = open_clip(folder / "clip")
    reached = [0]

    def follow(event: Event) -> None:
        reached[0] = event.iteration if isinstance(event, TrainingProgress) else reached[0]

    if halt is not None:
        assert train(clip, out, config, teacher=teacher, events=follow, stop=lambda: reached[0] >= halt) is None
    run = train(clip, out, config, teacher=teacher, resume=halt is not None, events=follow, stop=lambda: False)
    assert run is not None
    return read_tensors(run.path / "model.safetensors")


def tiny(iterations: int, device: str) -> TrainConfig:
    """A training of milliseconds a step."""
    values = {"max_gaussians": 400, "resolution": 8, "channels": 8, "checkpoint_seconds": 1e9}
    return TrainConfig.preset_of("quick", iterations=iterations, device=device, **values)


def long_finding(folder: Path, iterations: int, device: str) -> StressFinding:
    """A training far beyond any preset."""
    clip = open_clip(clip_cases()[0].make(folder / "clip"))
    events: list[Event] = []
    run = train(clip, folder / "run", tiny(iterations, device), events=events.append, stop=lambda: False)
    assert run is not None
    told = [event for event in events if isinstance(event, TrainingProgress) and event.psnr is not None]
    rollbacks = sum(isinstance(event, Rollback) for event in events)
    words = f"ok: PSNR of training frames {told[0].psnr:.1f} → {told[-1].psnr:.1f} dB, {rollbacks} rollbacks"
    return StressFinding(non_finite([read_tensors(run.path / "model.safetensors"), told]), words)


def twice_finding(folder: Path, size: tuple[int, int], device: str) -> StressFinding:
    """Two trainings from one seed."""
    make_phantom(folder / "clip", PhantomOptions(TWICE_FRAMES, *size))
    config = TrainConfig.preset_of("quick", iterations=TWICE_STEPS, semantic_steps=TWICE_STEPS, device=device)
    one, two = (trained(folder, folder / name, config, teacher="degraded:") for name in ("one", "two"))
    return difference(one, two, device)


def resumed_finding(folder: Path, device: str, steps: int = 300) -> StressFinding:
    """A training, and one that was stopped half way."""
    clip_cases()[0].make(folder / "clip")
    whole = trained(folder, folder / "one", tiny(steps, device))
    return difference(whole, trained(folder, folder / "two", tiny(steps, device), halt=steps // 2), device)


def difference(one: dict[str, torch.Tensor], two: dict[str, torch.Tensor], device: str) -> StressFinding:
    """How far two models are from each other: not a bit on the CPU."""
    if {name: tensor.shape for name, tensor in one.items()} != {name: tensor.shape for name, tensor in two.items()}:
        return StressFinding(
            non_finite([one, two]), "ok: another number of Gaussians" if device == "cuda" else "ANOTHER NUMBER OF GAUSSIANS"
        )
    most = max(float((one[name].double() - two[name].double()).abs().max()) for name in one if one[name].numel())
    same = all(torch.equal(one[name], two[name]) for name in one)
    return StressFinding(non_finite([one, two]), "ok" if same else "ok: not bit for bit" if device == "cuda" else "NOT THE SAME RUN", most)
