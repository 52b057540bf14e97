"""Numbers over long trainings: none that is not finite, and the same seed twice gives the same.

The trainings are a batch (`app.batch`), which is kept: what a call leaves undone, the next one does.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from degense.app.batch.folder import BatchFolder
from degense.app.batch.local import run_here
from degense.app.batch.plan import BatchJob, JobOptions
from degense.app.batch.progress import BatchProgress, JobProgress
from degense.app.features.runs.run_summaries import SCORES
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.table import Cell, Column
from degense.engine.research.stress.outcome import StressFinding, non_finite, row
from degense.engine.research.stress.scenes import large_finding, small_finding, stress_cases
from degense.engine.research.surgeries import DEVELOP
from degense.engine.scene import Scene
from degense.engine.store.files import read_json, read_tensors

FRAMES, WIDTH, HEIGHT, GAUSSIANS = 12, 64, 48, 400
COLUMNS = [
    Column("what", "what"),
    Column("cases", "cases", 0),
    Column("outcome", "outcome"),
    Column("bad", "numbers not finite", 0),
    Column("rollbacks", "rollbacks", 0),
    Column("psnr", "PSNR, dB", 2),
    Column("equal", "equal to the last bit", 0),
    Column("apart", "PSNR of the two apart, dB", 4),
    Column("tensors", "tensors of the two apart", 6),
]
#: What `--quick` chooses of a plan: to see that it runs.
QUICK: dict[str, Any] = {"scenes": 2, "iterations": 60, "short": 30, "gaussians": 100_000}
#: Inputs of the rasterizer whose type is another than float32, among the hostile scenes.
HALVES = ("half precision", "bfloat16")


@dataclass(frozen=True)
class NumericsPlan:
    """`scenes` of the family are trained for `iterations` steps, and twice with one seed for `short` ones, in the batch folder `out`.

    After `seconds` trainings save a checkpoint and end. `slots` are trainings at a time, `gaussians` are of the large scene that is drawn.
    """

    out: Path
    device: str = "cpu"
    scenes: int = 20
    iterations: int = 30_000
    short: int = 1_000
    slots: int = 1
    seconds: float = float("inf")
    gaussians: int = 1_000_000

    @property
    def clips(self) -> list[Path]:
        return [self.out / "clips" / f"{seed:03d}" for seed in DEVELOP[: self.scenes]]

    def jobs(self) -> list[BatchJob]:
        """The trainings, named by their clip and what they are for."""
        lengths = {"long": self.iterations, "once": self.short, "again": self.short}
        small: dict[str, Any] = {"preset": "quick", "max_gaussians": GAUSSIANS, "device": self.device, "seed": 0, "teacher": "labels"}
        return [
            JobOptions(**small, iterations=steps).job(clip, f"{clip.name}-{kind}", self.out)
            for kind, steps in lengths.items()
            for clip in self.clips
        ]


def train_all(plan: NumericsPlan, progress: Progress = silent) -> BatchProgress:
    """Do what is left of the trainings, until the time is over; how each ended."""
    begun = time.monotonic()
    for clip, seed in zip(plan.clips, DEVELOP, strict=False):
        if not clip.exists():
            make_phantom(clip, PhantomOptions(FRAMES, WIDTH, HEIGHT, seed, kind="family"))
    folder = BatchFolder(plan.out / "batch")
    jobs = folder.begin(plan.jobs())
    left = [job for job in jobs if folder.left(job)]
    state: BatchProgress = BatchProgress(
        jobs, [job for job in jobs if job not in left], lambda job: progress(_done(state), f"{job.name} {job.words}")
    )
    if left:
        run_here(folder, left, min(plan.slots, len(left)), plan.device, state, lambda: time.monotonic() - begun > plan.seconds)
    return state


def _done(state: BatchProgress) -> float:
    def share(job: JobProgress) -> float:
        return 1.0 if job.state == "done" else job.fraction if job.stage == "train" else 0.0

    return sum(map(share, state.jobs.values())) / len(state.jobs)


def rows(plan: NumericsPlan, progress: Progress = silent) -> Iterator[dict[str, Cell]]:
    """The lines of the table: drawing, long trainings, and the same seed twice."""
    yield from drawings(plan.device, plan.gaussians)
    state = train_all(plan, progress)
    runs = plan.out / "batch" / "runs"
    done = [name for name, job in state.jobs.items() if job.state == "done"]
    failed = [f"{name}: {job.words}" for name, job in state.jobs.items() if job.state == "failed"]
    long = [runs / name for name in done if name.endswith("-long")]
    pairs = [(runs / f"{clip.name}-once", runs / f"{clip.name}-again") for clip in plan.clips]
    pairs = [pair for pair in pairs if all(run.name in done for run in pair)]
    yield long_row(long, plan, [words for words in failed if "-long" in words.split(":")[0]])
    yield pair_row(pairs, plan, [words for words in failed if "-long" not in words.split(":")[0]])


def drawings(device: str, gaussians: int) -> Iterator[dict[str, Cell]]:
    """Gaussians in half precision, and very many of them, forward and backward beside float64."""
    cases: dict[str, Callable[[], StressFinding]] = {
        f"drawn from {case.name}": partial(small_finding, case, device) for case in stress_cases(11) if case.name in HALVES
    }
    cases[f"{gaussians:,} Gaussians drawn"] = partial(large_finding, gaussians, 1280, 720, 2.0, device)
    for name, work in cases.items():
        found = row(name, work)
        yield {"what": name, "cases": 1, "outcome": found["outcome"], "bad": found["bad"]}


def long_row(runs: Sequence[Path], plan: NumericsPlan, failed: Sequence[str]) -> dict[str, Cell]:
    """What long trainings left: every number of models, logs, scores and drawn frames."""
    bad = sum(non_finite_of(run, plan.device) for run in runs)
    rollbacks = sum(int(read_json(run / "run.json")["rollbacks"]) for run in runs)
    psnr = [_psnr(run) for run in runs]
    outcome = _outcome(failed, len(runs), plan.scenes, "NOT FINITE" * (bad > 0))
    return {
        "what": f"{plan.iterations:,} iterations",
        "cases": len(runs),
        "outcome": outcome,
        "bad": bad,
        "rollbacks": rollbacks,
        "psnr": psnr or None,
    }


def pair_row(pairs: Sequence[tuple[Path, Path]], plan: NumericsPlan, failed: Sequence[str]) -> dict[str, Cell]:
    """How far two trainings with one seed are apart: on the CPU not at all."""
    equal = sum((one / "model.safetensors").read_bytes() == (two / "model.safetensors").read_bytes() for one, two in pairs)
    apart = [abs(_psnr(one) - _psnr(two)) for one, two in pairs]
    wrong = "DIFFERENT" * (plan.device == "cpu" and equal < len(pairs))
    return {
        "what": f"one seed twice, {plan.short:,} iterations",
        "cases": len(pairs),
        "outcome": _outcome(failed, len(pairs), plan.scenes, wrong),
        "equal": equal,
        "psnr": [_psnr(one) for one, _ in pairs] or None,
        "apart": apart or None,
        "tensors": [tensors_apart(one, two) for one, two in pairs] or None,
    }


def non_finite_of(run: Path, device: str) -> int:
    """How many numbers of a run are not finite: of its model, its log, its scores, and colours and latents
    of its first and last frame. (A layer such as displacement says by NaN that nothing is known.)"""
    log = [json.loads(line) for line in (run / "metrics.jsonl").read_text(encoding="utf-8").splitlines()]
    numbers: list[object] = [read_tensors(run / "model.safetensors"), _numbers(log), _numbers(read_json(run / SCORES))]
    scene = Scene.open(run, device=device)
    numbers += [scene.render(frame, what=("rgb", "latent")) for frame in (0, scene.frames - 1)]
    return non_finite(numbers)


def tensors_apart(one: Path, two: Path) -> float:
    """How far the models of two runs are apart: ‖a − b‖ / ‖a‖ of the tensor furthest off; infinite where they have other numbers of
    Gaussians."""
    first, second = (read_tensors(run / "model.safetensors") for run in (one, two))
    if any(first[name].shape != second[name].shape for name in first):
        return float("inf")
    norms = [(first[name].double(), second[name].double()) for name in first if first[name].is_floating_point()]
    return max(float((a - b).norm() / a.norm().clamp(min=1e-12)) for a, b in norms)


def _numbers(values: Any) -> Any:
    """JSON values without their texts."""
    if isinstance(values, dict):
        return {name: _numbers(value) for name, value in values.items()}
    return [_numbers(value) for value in values] if isinstance(values, list) else values if isinstance(values, (int, float)) else None


def _psnr(run: Path) -> float:
    return float(read_json(run / SCORES)["psnr_full"])


def _outcome(failed: Sequence[str], done: int, wanted: int, wrong: str) -> str:
    if failed:
        return f"FAILED: {'; '.join(failed)[:300]}"
    return wrong or ("ok" if done == wanted else f"ok, {wanted - done} left")
