"""What sweeps have in common: systems, a preset and seeds, the folder that they are kept in, and how many trainings go on at a time."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.processes.capacity import trainings_at_once
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.systems import SYSTEMS, as_system
from degense.engine.store.files import read_json, write_json
from degense.engine.training.config import TrainConfig

METHODS = (*SYSTEMS, "coupled")
BUDGET = ("iterations", "max_gaussians")  # settings that have options of their own
QUICK = {"iterations": 120, "max_gaussians": 2000}


class Job(Protocol):
    """One training of a sweep."""

    @property
    def scene(self) -> Hashable:
        """What it shares with others: a clip, its flow and its baselines."""

    @property
    def name(self) -> str:
        """A name of its own, for files."""


@dataclass(frozen=True)
class Schedule(ABC):
    """A sweep, and the folder that it is kept in.

    Attributes
    ----------
    out : Path
        Holds `baselines/`, `flow/`, `scores/` (one file a job) and `sweep.json`, what must stay the same.
    settings : dict
        Training settings in place of the preset's.
    slots : int
        Trainings at a time.
    time_limit : float
        Seconds after which nothing new is begun.
    tables_only : bool
        Make tables of what is there, and train nothing.
    """

    out: Path
    methods: tuple[str, ...] = ("degense", "degensegs", "surgtpgs", "coupled")
    preset: str = "balanced"
    settings: dict[str, Any] = field(default_factory=dict)
    seeds: tuple[int, ...] = (0,)
    device: str = "cpu"
    slots: int = 1
    baselines: bool = True
    time_limit: float = float("inf")
    tables_only: bool = False

    @property
    @abstractmethod
    def jobs(self) -> Sequence[Any]:
        """Its trainings (`Job`)."""

    @property
    @abstractmethod
    def scenes(self) -> Sequence[Any]:
        """What its jobs share (`Job.scene`)."""

    @property
    @abstractmethod
    def fixed(self) -> dict[str, Any]:
        """What must stay the same for the folder to be gone on with."""

    def scores(self, job: Job) -> Path:
        return self.out / "scores" / f"{job.name}.json"

    def config(self, method: str, seed: int) -> TrainConfig:
        """The settings of a method."""
        config = TrainConfig.preset_of(self.preset, **self.settings, device=self.device, seed=seed, checkpoint_seconds=1e9)
        return replace(config, routing="coupled") if method == "coupled" else as_system(method, config)

    def begin(self) -> None:
        """Keep what is `fixed` in `sweep.json`. DegenseError when the folder holds a sweep with other settings."""
        path = self.out / "sweep.json"
        if path.exists() and read_json(path) != self.fixed:
            raise DegenseError(f"{self.out} holds a sweep with other settings; go on with the same ones, or choose another folder")
        if not path.exists():
            if self.tables_only:
                raise DegenseError(f"{self.out} holds no sweep to make tables of; train one without --tables-only")
            write_json(path, self.fixed)
            write_text(self.out / ".gitignore", "*\n")

    def options(self) -> list[str]:
        """The words of the command line that say what all sweeps have."""
        words = ["--methods", ",".join(self.methods), "--preset", self.preset]
        words += ["--seeds", str(len(self.seeds)), "--device", self.device, "--slots", str(self.slots)]
        for name, value in self.settings.items():
            words += [f"--{name.replace('_', '-')}", str(value)] if name in BUDGET else ["--set-option", f"{name}={json.dumps(value)}"]
        return [*words, "--out", "OUT"]


def said(options: BenchOptions) -> Mapping[str, Any]:
    """What the command line says of a sweep, by name."""
    return {name: value for name, value in options.sweep.items() if value is not None}


def names_of(text: str) -> tuple[str, ...]:
    """Names separated by commas, each once."""
    return tuple(dict.fromkeys(filter(None, text.split(","))))


def schedule_of(options: BenchOptions) -> dict[str, Any]:
    """The fields of a `Schedule` that the command line asks for. DegenseError for systems that there are not."""
    given = said(options)
    fields: dict[str, Any] = {
        "out": options.out or options.scratch,
        "settings": {name: given[name] for name in BUDGET if name in given} | given.get("settings", {}),
        "seeds": options.seeds,
        "device": options.device,
        "slots": given.get("slots") or trainings_at_once(options.device),
        "baselines": not given.get("no_baselines"),
    }
    fields |= {name: given[name] for name in ("preset", "time_limit", "tables_only") if name in given}
    if "methods" in given:
        fields["methods"] = names_of(given["methods"])
    check_known(fields.get("methods", ()), METHODS)
    return fields


def check_known(names: Sequence[str], known: Sequence[str]) -> None:
    """DegenseError unless all names are known."""
    if wrong := [name for name in names if name not in known]:
        raise DegenseError(f"a sweep knows no {wrong[0]!r}; choose from {', '.join(known)}")
