"""A batch against the same commands one by one, and on two Dask workers of which one is killed. `degense bench batch` prints it."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.processes.capacity import NUMERIC, cores, gpus, thread_environment, trainings_at_once
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Column, Table
from degense.engine.research.bench.workers import run_jobs
from degense.engine.research.surgeries import DEVELOP


class Plan(NamedTuple):
    """What is done, at full size on a kind of device or quickly."""

    clips: int
    alone: int  # of them are done by commands; their seconds stand for those of the others too
    in_one: int  # likewise by one slot
    frames: int
    size: tuple[int, int]  # width and height, pixels
    settings: tuple[str, ...]  # of the trainings


FULL = {"cpu": Plan(20, 5, 20, 17, (96, 80), ("--preset", "quick")), "cuda": Plan(20, 3, 3, 48, (320, 256), ("--preset", "balanced"))}
SHORT = ("--preset", "quick", "--iterations", "75", "--max-gaussians", "200", "--set", "semantic_steps=10")
QUICK = Plan(20, 5, 20, 5, (48, 40), SHORT)
ASKED = ("--prompt", "liver", "--export", "ply")
#: Often enough for a killed training to have one.
CHECKPOINTS = ("--set", "checkpoint_seconds=1")


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """The table of batches. DegenseError when one of the commands fails."""
    plan = QUICK if options.quick else FULL[options.device]
    said = (*plan.settings, *CHECKPOINTS, "--device", options.device)
    clips = [options.scratch / "clips" / f"{seed:03d}" for seed in DEVELOP[: plan.clips]]
    list(run_jobs(partial(draw, plan), clips, cores(), lambda f, told: progress(0.05 * f, told), "drawing clips"))
    slots = trainings_at_once(options.device)
    table = described(plan, options.device, slots)
    words = ["batch", *said, *ASKED, "--json"]
    place = {name: options.scratch / name for name in ("alone", "one", "slots", "dask")}
    alone = one_by_one(clips[: plan.alone], said, place["alone"], lambda f, told: progress(0.05 + 0.4 * f, told)) * plan.clips / plan.alone
    one_slot = [*words, *map(str, clips[: plan.in_one]), "--out", str(place["one"]), "--slots", "1"]
    in_one = batch(one_slot, lambda f: progress(0.45 + 0.25 * f, "1 slot")) * plan.clips / plan.in_one
    found = {"four commands each": alone, "batch, 1 slot": in_one}
    words += map(str, clips)
    several = f"batch, {slots} slots"
    found[several] = batch([*words, "--out", str(place["slots"]), "--slots", str(slots)], lambda f: progress(0.7 + 0.15 * f, several))
    workers = "two Dask workers, one killed"
    if options.device == "cpu":
        found[workers] = on_workers(words, place["dask"], lambda f: progress(0.85 + 0.15 * f, workers))
    table.rows += [{"what": what, "seconds": s, "ratio": s / alone, "of_slot": s / in_one, "equal": None} for what, s in found.items()]
    if options.device == "cpu" and cores() == slots:
        table.rows[-1]["equal"] = equal_models(place["slots"], place["dask"])
    yield table


def draw(plan: Plan, clip: Path) -> None:
    """Draw the surgery that a clip is named after."""
    make_phantom(clip, PhantomOptions(plan.frames, *plan.size, int(clip.name), kind="family"))


def described(plan: Plan, device: str, slots: int) -> Table:
    """The table, without rows."""
    width, height = plan.size
    by_commands, in_one = (
        "" if count == plan.clips else f" (the first {count}, times {plan.clips / count:g})" for count in (plan.alone, plan.in_one)
    )
    told = (
        f"{plan.clips} surgeries of the family (seeds {DEVELOP[0]} to {DEVELOP[plan.clips - 1]}), {plan.frames} frames of "
        f"{width} × {height}, {' '.join(plan.settings)}. Each is trained, scored, asked one question and exported: by four commands with "
        f"all {cores()} cores{by_commands}; by a batch with one slot, so in one process with all cores{in_one}; "
    )
    if device == "cuda":
        told += f"and by one with {slots} slots on {len(gpus())} GPU(s). `eval` alone measures speed too."
    else:
        told += (
            f"by one with {slots} slots; and by one on two Dask workers of one thread each, of which one is killed (SIGKILL) in its first "
            "training. `eval` alone measures speed too. Equal: models with the bits that slots of one thread give."
        )
    return Table(
        "batch",
        "Many clips",
        told,
        [
            Column("what", "what"),
            Column("seconds", "seconds", 1),
            Column("ratio", "of the commands", 3),
            Column("of_slot", "of one slot", 3),
            Column("equal", "equal models", 0),
        ],
    )


def one_by_one(clips: Sequence[Path], said: Sequence[str], out: Path, progress: Progress) -> float:
    """Seconds of the commands that a batch stands for."""
    begun = time.perf_counter()
    for done, clip in enumerate(clips):
        progress(done / len(clips), f"{clip.name} by itself")
        folder = out / clip.name
        for command in (
            ("train", clip, "--out", folder, *said),
            ("eval", folder, "--json", out / f"{clip.name}.json"),
            ("query", folder, "liver", "--json", out / f"{clip.name}-answers.json"),
            ("export", folder, "--format", "ply", "--prompt", "liver", "--out", out / f"{clip.name}.ply"),
        ):
            _call([sys.executable, "-m", "degense.app", *map(str, command)])
    return time.perf_counter() - begun


def batch(words: Sequence[str], progress: Any, heard: Any = None) -> float:
    """Seconds of a batch; `progress(share)` hears how much is done and `heard(event)` every event."""
    begun, ended, total = time.perf_counter(), 0, 1
    command = [sys.executable, "-m", "degense.app", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        for line in process.stdout:
            event = json.loads(line)
            total = event.get("jobs", total) if event["event"] == "batch" else total
            ended += event.get("state") in ("done", "failed")
            progress(ended / total)
            if heard is not None:
                heard(event)
        if process.wait() != 0:
            raise DegenseError(f"The batch failed: {process.stderr.read()[-500:]}.")
    return time.perf_counter() - begun


def on_workers(words: Sequence[str], out: Path, progress: Any) -> float:
    """Seconds of a batch on two Dask workers, one of which is killed in its first training."""
    out.mkdir(parents=True)
    file, folder = out.with_suffix(".json"), out.with_suffix(".workers")
    shown = ("--no-dashboard", "--scheduler-file", str(file))
    processes = [_start(("-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *shown))]
    for name in ("w0", "w1"):
        own = ("--name", name, "--nthreads", "1", "--no-nanny", "--local-directory", str(folder))
        processes.append(_start(("-m", "distributed.cli.dask_worker", *shown, *own)))
    killed: list[bool] = []

    def heard(event: dict[str, Any]) -> None:
        if not killed and event.get("stage") == "train" and event["fraction"] > 0.3:
            processes[1].kill()
            killed.append(True)

    try:
        while not file.is_file():
            time.sleep(0.1)
        address = json.loads(file.read_text(encoding="utf-8"))["address"]
        return batch([*words, "--out", str(out), "--cluster", address], progress, heard)
    finally:
        for process in processes:
            process.kill()
            process.wait()


def equal_models(one: Path, other: Path) -> int:
    """How many runs of two batches have models that are equal to the last bit."""

    def sums(folder: Path) -> dict[str, str]:
        files = (folder / "runs").glob("*/model.safetensors")
        return {file.parent.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}

    return len(sums(one).items() & sums(other).items())


def _start(words: Sequence[str]) -> subprocess.Popen[bytes]:
    environment = {**os.environ, **thread_environment(1)}
    return subprocess.Popen([sys.executable, *words], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _call(command: Sequence[str]) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in NUMERIC}
    found = subprocess.run(command, env=environment, capture_output=True, text=True)
    if found.returncode:
        raise DegenseError(f"{' '.join(command[3:5])} failed: {found.stderr[-500:]}.")
