"""Settings, cost and scores of the runs of a folder. No Qt."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from degense.engine.errors import DegenseError
from degense.engine.untrusted import parse_json, read_json

#: Where `score` leaves the scores of a run, as `degense eval RUN --json` writes them.
SCORES = "scores.json"
LARGEST, TAIL, MOST = 16 << 20, 1 << 16, 1000


@dataclass(frozen=True)
class RunSummary:
    """A line of the list. What the run folder does not say is None."""

    path: Path
    state: str  # training, stopped, diverged, finished, or "damaged"
    clip: str = ""
    preset: str = ""
    routing: str = ""
    teacher: str = ""
    created: str = ""
    iteration: int | None = None
    gaussians: int | None = None
    train_seconds: float | None = None
    training_psnr: float | None = None  # of the training frames, at the last report
    psnr: float | None = None  # dB, of held-out frames, as the next two; None where the run was not scored
    miou: float | None = None  # 0 to 1 (decoder rnse)
    displacement_error: float | None = None  # in the clip's unit

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def resumable(self) -> bool:
        return self.state in ("training", "stopped", "diverged")


def list_runs(folder: Path) -> list[RunSummary]:
    """The runs in `folder`, newest first; at most `MOST` entries are read. DegenseError when the folder cannot be read."""
    try:
        inside = sorted(os.scandir(folder), key=lambda entry: entry.name)[:MOST]
        found = [summary(Path(entry.path)) for entry in inside if entry.is_dir() and (Path(entry.path) / "run.json").is_file()]
    except OSError as error:
        raise DegenseError(f"{folder} cannot be read: {error.strerror}.") from error
    return sorted(found, key=lambda run: run.created, reverse=True)


def summary(path: Path) -> RunSummary:
    """What the files of a run say about it; a damaged run is listed as such."""
    try:
        info = _read(path / "run.json")
        config, teacher, clip = (_dict(info.get(key)) for key in ("config", "teacher", "clip"))
        scores = _read(path / SCORES) if (path / SCORES).is_file() else {}
        last = _last_line(path / "metrics.jsonl")
    except (OSError, ValueError):
        return RunSummary(path, "damaged")
    return RunSummary(
        path=path,
        state=str(info.get("state", "damaged")),
        clip=str(clip.get("name", "")),
        preset=str(config.get("preset", "")),
        routing=str(config.get("routing", "")),
        teacher=str(teacher.get("name") or ""),
        created=str(info.get("created", "")),
        iteration=_whole(last.get("iteration")),
        gaussians=_whole(info.get("gaussians")) or _whole(last.get("gaussians")),
        train_seconds=_number(info.get("train_seconds")),
        training_psnr=_number(last.get("psnr")),
        psnr=_number(scores.get("psnr_mask")),
        miou=_number(_dict(scores.get("miou")).get("rnse")),
        displacement_error=_number(scores.get("displacement_error")),
    )


def training_answers(path: Path) -> dict[str, Any]:
    """The settings a run was trained with, as `TrainingJob.with_answers` takes them. DegenseError when the run cannot be read."""
    try:
        info = _read(path / "run.json")
    except (OSError, ValueError) as error:
        raise DegenseError(f"{path} cannot be read: {error}.") from error
    config, teacher = _dict(info.get("config")), _dict(info.get("teacher"))
    named = ("preset", "routing", "iterations", "max_gaussians", "device", "seed")
    given = config.get("given")
    chosen = set(given if isinstance(given, list) else ())
    answers = {name: config[name] for name in named if name in config and (name in chosen or name in ("preset", "routing", "seed"))}
    others = sorted(chosen - set(named))
    return answers | {
        "teacher": teacher.get("name"),
        "settings": tuple((name, json.dumps(config[name])) for name in others if name in config),
    }


def _read(path: Path) -> dict[str, Any]:
    data = read_json(path, LARGEST)
    if not isinstance(data, dict):
        raise ValueError(f"{path.name} is no JSON object")
    return data


def _last_line(path: Path) -> dict[str, Any]:
    """The last whole report of a trainer, which has a PSNR, unlike those of the distillation; empty where there is none yet."""
    if not path.is_file():
        return {}
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL))
        lines = file.read().split(b"\n")[:-1]
    reports = (_dict(parse_json(line)) for line in reversed(lines) if line.startswith(b"{"))
    return next((report for report in reports if report.get("psnr") is not None), {})


def _dict(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _whole(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
