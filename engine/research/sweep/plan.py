"""What a sweep over the family of surgeries trains: scenes × depths × teachers × methods × seeds."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal, get_args

from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.processes.capacity import trainings_at_once
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.degraded_teachers import ErrorModel
from degense.engine.research.surgeries import DEVELOP, REPORT
from degense.engine.research.systems import SYSTEMS, as_system
from degense.engine.store.files import read_json, write_json
from degense.engine.training.config import TrainConfig

Depth = Literal["exact", "noisy", "none"]
SETS = {"develop": DEVELOP, "report": REPORT}
METHODS = (*SYSTEMS, "coupled")
BUDGET = ("iterations", "max_gaussians")  # settings that have options of their own
#: All nine cells of degraded teachers, which "degraded" alone stands for.
CELLS = tuple(f"degraded:model={model},strength={strength}" for model, strength in product(get_args(ErrorModel), (1, 2, 3)))


@dataclass(frozen=True)
class SweepJob:
    """One training."""

    scene: int
    depth: Depth
    teacher: str
    method: str
    seed: int

    @property
    def cell(self) -> str:
        """The name of its depth and teacher."""
        return f"{self.depth}-{slug(self.teacher)}"

    @property
    def name(self) -> str:
        return f"{self.scene:03d}-{self.cell}-{self.method}-{self.seed}"

    @property
    def seeded_teacher(self) -> str:
        """The teacher with chances of its own for each seed of a training."""
        return seeded(self.teacher, self.seed)


@dataclass(frozen=True)
class SweepPlan:
    """A sweep, and the folder that it is kept in.

    Attributes
    ----------
    out : Path
        Holds `clips/`, `baselines/`, `flow/`, `scores/` (one file a job) and `sweep.json`, what must stay the same.
    which : {"develop", "report"}
    size : (int, int)
        Width and height of the clips, which have so many `frames`.
    settings : dict
        Training settings in place of the preset's; none on `report`, on which nothing is chosen.
    slots : int
        Trainings at a time.
    time_limit : float
        Seconds after which nothing new is begun.
    tables_only : bool
        Make tables of what is there, and train nothing.
    """

    out: Path
    which: str = "develop"
    scenes: tuple[int, ...] = tuple(DEVELOP[:6])
    size: tuple[int, int] = (320, 256)
    frames: int = 48
    methods: tuple[str, ...] = ("degense", "degensegs", "surgtpgs", "coupled")
    teachers: tuple[str, ...] = ("labels",)
    depths: tuple[Depth, ...] = ("exact",)
    preset: str = "balanced"
    settings: dict[str, Any] = field(default_factory=dict)
    seeds: tuple[int, ...] = (0,)
    device: str = "cpu"
    slots: int = 1
    baselines: bool = True
    time_limit: float = float("inf")
    tables_only: bool = False

    @property
    def jobs(self) -> list[SweepJob]:
        """Scene by scene, so that what is done when the time is over has every method."""
        order = product(self.depths, self.teachers, self.scenes, self.seeds, self.methods)
        return [SweepJob(scene, depth, teacher, method, seed) for depth, teacher, scene, seed, method in order]

    def clip(self, scene: int, depth: Depth) -> Path:
        width, height = self.size
        return self.out / "clips" / f"{scene:03d}-{width}x{height}-{self.frames}-{depth}"

    def scores(self, job: SweepJob) -> Path:
        return self.out / "scores" / f"{job.name}.json"

    def config(self, method: str, seed: int) -> TrainConfig:
        """The settings of a method."""
        config = TrainConfig.preset_of(self.preset, **self.settings, device=self.device, seed=seed, checkpoint_seconds=1e9)
        return replace(config, routing="coupled") if method == "coupled" else as_system(method, config)

    def begin(self) -> None:
        """Keep what must stay the same in `sweep.json`. DegenseError when the folder holds a sweep with other settings."""
        fixed = {"set": self.which, "size": list(self.size), "frames": self.frames, "preset": self.preset, "settings": self.settings}
        path = self.out / "sweep.json"
        if path.exists() and read_json(path) != fixed:
            raise DegenseError(f"{self.out} holds a sweep with other settings; go on with the same ones, or choose another folder")
        if not path.exists():
            if self.tables_only:
                raise DegenseError(f"{self.out} holds no sweep to make tables of; train one without --tables-only")
            write_json(path, fixed)
            write_text(self.out / ".gitignore", "*\n")

    def command(self) -> str:
        """What to type to do it again."""
        width, height = self.size
        words = [
            "degense",
            "bench",
            "surgeries",
            "--set",
            self.which,
            "--scenes",
            ",".join(map(str, self.scenes)) + "," * (len(self.scenes) == 1),
        ]
        words += ["--size", f"{width}x{height}", "--frames", str(self.frames), "--methods", ",".join(self.methods)]
        words += ["--teachers", ",".join(self.teachers), "--depth", ",".join(self.depths), "--preset", self.preset]
        words += ["--seeds", str(len(self.seeds)), "--device", self.device, "--slots", str(self.slots)]
        for name, value in self.settings.items():
            words += [f"--{name.replace('_', '-')}", str(value)] if name in BUDGET else ["--set-option", f"{name}={json.dumps(value)}"]
        return shlex.join([*words, "--out", "OUT"])


def plan_of(options: BenchOptions) -> SweepPlan:
    """The sweep that the command line asks for. DegenseError for what there is not, and for settings on `report`."""
    given: Mapping[str, Any] = {name: value for name, value in options.sweep.items() if value is not None}
    which = given.get("which", "develop")
    if which not in SETS:
        raise DegenseError(f"there is no set {which!r} of surgeries; choose {' or '.join(SETS)}")
    settings = {name: given[name] for name in BUDGET if name in given} | given.get("settings", {})
    if settings and which == "report":
        raise DegenseError(f"nothing is chosen on the set report: leave {', '.join(settings)} out, or use --set develop")
    chosen: dict[str, Any] = {"settings": settings, "seeds": options.seeds, "device": options.device}
    if options.quick:
        chosen |= {"scenes": tuple(SETS[which][:2]), "size": (96, 80), "frames": 17}
        if which == "develop" and not settings:
            chosen["settings"] = {"iterations": 120, "max_gaussians": 2000}
    chosen |= {name: given[name] for name in ("size", "frames", "preset", "time_limit", "tables_only") if name in given}
    chosen |= {name: tuple(dict.fromkeys(filter(None, given[name].split(",")))) for name in ("methods", "depths") if name in given}
    if "teachers" in given:
        chosen["teachers"] = teachers_of(given["teachers"])
    if "scenes" in given or which == "report":
        chosen["scenes"] = scenes_of(given.get("scenes", str(len(SETS[which]))), SETS[which])
    slots = given.get("slots") or trainings_at_once(options.device)
    plan = SweepPlan(options.out or options.scratch, which, slots=slots, baselines=not given.get("no_baselines"), **chosen)
    for names, known in ((plan.methods, METHODS), (plan.depths, get_args(Depth))):
        if wrong := [name for name in names if name not in known]:
            raise DegenseError(f"a sweep knows no {wrong[0]!r}; choose from {', '.join(known)}")
    for method in plan.methods:
        plan.config(method, 0)
    return plan


def scenes_of(text: str, seeds: range) -> tuple[int, ...]:
    """The first seeds of a set ("6"), or those that are named ("0,3,7" or "5,"). DegenseError for seeds of no or another set."""
    try:
        numbers = [int(word) for word in text.split(",") if word]
    except ValueError:
        raise DegenseError(f"{text!r} names no scenes; say how many, or their seeds separated by commas") from None
    found = tuple(numbers) if "," in text else tuple(seeds[: numbers[0]]) if numbers else ()
    if not found or not set(found) <= set(seeds):
        raise DegenseError(f"{text!r} names no scenes of the set; its seeds are {seeds[0]} to {seeds[-1]}")
    return found


def teachers_of(text: str) -> tuple[str, ...]:
    """Teachers separated by commas, of which those within a degraded teacher's name are none; "degraded" alone is all of `CELLS`."""
    names = re.split(r",(?=labels|none|degraded|unseen)", text)
    return tuple(cell for name in names for cell in (CELLS if name == "degraded" else (name,)))


def seeded(teacher: str, seed: int) -> str:
    """A degraded teacher, or the unseen one, with the chances of a seed, unless its name has one."""
    if teacher == "unseen":
        return f"unseen:seed={seed}"
    return f"{teacher},seed={seed}" if teacher.startswith("degraded:") and "seed=" not in teacher else teacher


def slug(teacher: str) -> str:
    """A teacher's name as part of a file's: "degraded:model=flips,strength=2" becomes "flips-2"."""
    return re.sub(r"\W+", "-", re.sub(r"degraded:|model=|strength=", "", teacher))
