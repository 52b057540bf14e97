"""What a sweep over the family of surgeries trains: scenes × depths × teachers × methods × seeds."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal, get_args

from degense.engine.errors import DegenseError
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.degraded_teachers import ErrorModel
from degense.engine.research.surgeries import DEVELOP, REPORT
from degense.engine.research.sweep.schedule import QUICK, Schedule, check_known, names_of, said, schedule_of

Depth = Literal["exact", "noisy", "none"]
SETS = {"develop": DEVELOP, "report": REPORT}
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
class SweepPlan(Schedule):
    """A sweep over surgeries; its folder holds `clips/` too.

    Attributes
    ----------
    which : {"develop", "report"}
        On `report` nothing is chosen, so it takes no `settings`.
    size : (int, int)
        Width and height of the clips, which have so many `frames`.
    """

    which: str = "develop"
    scenes: tuple[int, ...] = tuple(DEVELOP[:6])
    size: tuple[int, int] = (320, 256)
    frames: int = 48
    teachers: tuple[str, ...] = ("labels",)
    depths: tuple[Depth, ...] = ("exact",)

    @property
    def jobs(self) -> list[SweepJob]:
        """Scene by scene, so that what is done when the time is over has every method."""
        order = product(self.depths, self.teachers, self.scenes, self.seeds, self.methods)
        return [SweepJob(scene, depth, teacher, method, seed) for depth, teacher, scene, seed, method in order]

    def clip(self, scene: int, depth: Depth) -> Path:
        width, height = self.size
        return self.out / "clips" / f"{scene:03d}-{width}x{height}-{self.frames}-{depth}"

    @property
    def fixed(self) -> dict[str, Any]:
        return {"set": self.which, "size": list(self.size), "frames": self.frames, "preset": self.preset, "settings": self.settings}

    def command(self) -> str:
        """What to type to do it again."""
        width, height = self.size
        scenes = ",".join(map(str, self.scenes)) + "," * (len(self.scenes) == 1)
        words = ["degense", "bench", "surgeries", "--set", self.which, "--scenes", scenes, "--size", f"{width}x{height}"]
        words += ["--frames", str(self.frames), "--teachers", ",".join(self.teachers), "--depth", ",".join(self.depths)]
        return shlex.join([*words, *self.options()])


def plan_of(options: BenchOptions) -> SweepPlan:
    """The sweep that the command line asks for. DegenseError for what there is not, and for settings on `report`."""
    given, chosen = said(options), schedule_of(options)
    which, settings = given.get("which", "develop"), chosen["settings"]
    if which not in SETS:
        raise DegenseError(f"there is no set {which!r} of surgeries; choose {' or '.join(SETS)}")
    if "held_out_maps" in given:
        raise DegenseError("surgeries have a label map of every frame: leave --held-out-maps out, which is for real clips")
    if settings and which == "report":
        raise DegenseError(f"nothing is chosen on the set report: leave {', '.join(settings)} out, or use --set develop")
    if options.quick:
        chosen |= {"scenes": tuple(SETS[which][:2]), "size": (96, 80), "frames": 17}
        if which == "develop" and not settings:
            chosen["settings"] = QUICK
    chosen |= {name: given[name] for name in ("size", "frames") if name in given}
    if "depths" in given:
        chosen["depths"] = names_of(given["depths"])
        check_known(chosen["depths"], get_args(Depth))
    if "teachers" in given:
        chosen["teachers"] = teachers_of(given["teachers"])
    if "scenes" in given or which == "report":
        chosen["scenes"] = scenes_of(given.get("scenes", str(len(SETS[which]))), SETS[which])
    plan = SweepPlan(which=which, **chosen)
    for method in plan.methods:
        plan.config(method, 0)
    return plan


def scenes_of(text: str, seeds: range) -> tuple[int, ...]:
    """The first seeds of a set ("6"), or those that are named ("0,3,7" or "5,"). DegenseError for seeds of no or another set."""
    try:
        numbers = [int(word) for word in text.split(",") if word]
    except ValueError:
        raise DegenseError(f"{text!r} names no scenes; say how many, or their seeds separated by commas") from None
    if "," not in text and numbers and numbers[0] > len(seeds):
        raise DegenseError(f"the set has {len(seeds)} scenes, not {numbers[0]}; one of them is named with a comma: {numbers[0]},")
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
