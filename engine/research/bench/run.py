"""Every benchmark by its name, what it is told, and how it is run."""

from __future__ import annotations

import importlib
import platform
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import torch

from degense.engine.errors import DegenseError
from degense.engine.processes.capacity import cores
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.table import Table

#: Name → (module with `run(options, progress) -> Iterable[Table]`, what it answers).
Benches = dict[str, tuple[str, str]]
CLIPS = "clips"  # needs clips, so it is not among "all"
BENCHES: Benches = {
    "raster": (
        "degense.engine.research.benchmarks.raster",
        "what a picture and its gradient cost on each back end, and how wrong they are",
    ),
    "field": (
        "degense.engine.research.benchmarks.field",
        "what a state in time costs: exact, baked, half precision, with and without the savings",
    ),
    "viewing": ("degense.engine.research.benchmarks.viewing", "how fast a scene plays and answers prompts"),
    "query": ("degense.engine.research.benchmarks.query", "how long a whole clip takes to answer prompts"),
    "search": ("degense.engine.research.benchmarks.search", "how long a question to an archive takes, and how its index grows"),
    "masks": ("degense.engine.research.benchmarks.masks", "superpixels and decoders: time against mask quality"),
    "presets": ("degense.engine.research.benchmarks.presets", "what the presets cost and reach on a phantom"),
    "cameras": (
        "degense.engine.research.benchmarks.cameras",
        "camera poses from the frames: how far off they are, and what they do to a reconstruction",
    ),
    "surgeries": (
        "degense.engine.research.sweep",
        "a family of surgeries: systems, teachers and depths against exact truth and baselines; resumes",
    ),
    CLIPS: (
        "degense.engine.research.real_clips",
        "real clips, each named with --clip: systems and baselines on held-out frames, and tracks; resumes",
    ),
    "ablation": (
        "degense.engine.research.benchmarks.ablation",
        "the paper's ablation with degraded teachers, against exact masks and motion",
    ),
    "parts": (
        "degense.engine.research.benchmarks.parts",
        "the default less each part in which it differs from the paper, against exact masks and motion",
    ),
    "annotation": (
        "degense.engine.research.benchmarks.annotation",
        "one corrected frame, propagated to all others: mask quality against exact labels",
    ),
    "carrying": (
        "degense.engine.research.benchmarks.carrying",
        "labels of one frame carried to all: content that entered later, and whether the confidence is right",
    ),
    "hand-held": (
        "degense.engine.research.hand_held",
        "a long clip of a hand-held camera with one labelled frame: masks at its end, and what entered later",
    ),
    "observability": (
        "degense.engine.research.benchmarks.observability",
        "the uncertainty of displacement: how often its bound is kept, and whether it sorts the errors",
    ),
    "correcting": (
        "degense.engine.research.benchmarks.correcting",
        "frames corrected by expected error or evenly spaced: mask quality by their number, and the reliability of the confidence",
    ),
    "growth": ("degense.engine.research.growth", "what a training costs with more frames, pixels, Gaussians and classes"),
    "stress": ("degense.engine.research.stress", "hostile scenes and clips: no crash, no NaN, error against float64"),
}


@dataclass(frozen=True)
class BenchOptions:
    """What every benchmark is told.

    Attributes
    ----------
    device : {"cpu", "cuda"}
    seeds : tuple of int
        Of trainings and random scenes; figures over seeds are stated with their spread.
    repeats : int
        Of each timing.
    quick : bool
        Smaller scenes and shorter trainings: to see that it runs, not to quote.
    scratch : Path
        A folder for clips and runs made on the way; its owner deletes it.
    clips : tuple of Path
        Real clips to measure on.
    out : Path or None
        Where tables go; a sweep is kept there too.
    sweep : dict
        What some benchmarks alone are told: `surgeries` and `clips` (`engine.research.sweep.schedule`), or `reliability` of the program.
    """

    device: str
    seeds: tuple[int, ...]
    repeats: int
    quick: bool
    scratch: Path
    clips: tuple[Path, ...] = ()
    out: Path | None = None
    sweep: Mapping[str, Any] = field(default_factory=dict)


def run(name: str, options: BenchOptions, progress: Progress = silent, benches: Benches = BENCHES) -> Iterator[Table]:
    """The tables of one benchmark, as they are finished. Raises DegenseError for a name that is none of `benches`."""
    check_names([name], benches)
    for number, table in enumerate(importlib.import_module(benches[name][0]).run(options, progress)):
        table.bench, table.device, table.number = name, options.device, number
        table.command = table.command or command_line(name, options)
        table.hardware, table.date = hardware(options.device), date.today().isoformat()
        yield table


def check_names(names: list[str], benches: Benches = BENCHES) -> None:
    """DegenseError unless every name is one of `benches`."""
    if unknown := [name for name in names if name not in benches]:
        raise DegenseError(f"There is no benchmark {unknown[0]!r}; choose from {', '.join(benches)}, or all.")


def command_line(name: str, options: BenchOptions) -> str:
    """What to type to measure this again, with everything that was chosen; of a clip only its folder's name, not where it lies."""
    words = ["degense", "bench", name, "--device", options.device]
    words += ["--seeds", str(len(options.seeds)), "--repeats", str(options.repeats)]
    words += ["--quick"] * options.quick
    for clip in options.clips:
        words += ["--clip", clip.resolve().name]
    return shlex.join(words)


def hardware(device: str) -> str:
    """This machine in words."""
    words = f"{cores()} cores {platform.machine()}, torch {torch.__version__}"
    return f"{torch.cuda.get_device_name()}, {words}" if device == "cuda" else f"{_processor()}{words}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line.split(":", 1)[1].strip() + ", " for line in lines if line.startswith("model name")), "")
