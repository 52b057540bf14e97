"""What a training reports while it runs: one frozen dataclass an event, and their JSON form at the border of a process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeAlias, get_args, get_type_hints

from degense.engine.untrusted import parse_json

#: The stages of a training, in their order. `coarse` and `joint` are steps of the trainer; `semantics` is the distillation after them.
STAGES = ("poses", "load", "teacher", "flow", "coarse", "joint", "semantics")


@dataclass(frozen=True)
class Stage:
    """One of `STAGES` begins."""

    stage: str


@dataclass(frozen=True)
class Step:
    """How far a stage other than the trainer's has come, 0 to 1, and what it does."""

    stage: str
    fraction: float
    message: str


@dataclass(frozen=True)
class TrainingProgress:
    """Means over the steps since the last such event. Steps of the distillation count on from those of the trainer."""

    iteration: int  # steps made
    iterations: int  # all that will be made, those of the distillation among them
    loss: float | None = None
    psnr: float | None = None  # dB over the valid pixels of the training frames; None in the distillation, which draws no colours
    gaussians: int | None = None
    seconds: float | None = None  # since the training began, without pauses
    eta: float | None = None  # seconds until its end
    losses: dict[str, float] = field(default_factory=dict)  # every weighted term by name; they add up to `loss`


@dataclass(frozen=True)
class Reliability:
    """How often the teacher contradicts what all its frames agree on, in words."""

    words: str


@dataclass(frozen=True)
class Preview:
    """A frame was drawn to an image file."""

    path: str
    frame: int


@dataclass(frozen=True)
class Rollback:
    """Training diverged and went back to the step `iteration`."""

    iteration: int
    reason: str


@dataclass(frozen=True)
class Done:
    """The run in the folder `run` is finished."""

    run: str


@dataclass(frozen=True)
class Stopped:
    """The training left on request after `iteration` steps; it can be resumed unless that is 0."""

    iteration: int


@dataclass(frozen=True)
class Failed:
    """The training ended with an error, in words for the user."""

    message: str


Event: TypeAlias = Stage | Step | TrainingProgress | Reliability | Preview | Rollback | Done | Stopped | Failed
Events: TypeAlias = Callable[[Event], None]

#: The value of "event" in each event's JSON form.
NAMES: dict[str, type[Event]] = {
    "stage": Stage,
    "step": Step,
    "progress": TrainingProgress,
    "reliability": Reliability,
    "preview": Preview,
    "rollback": Rollback,
    "done": Done,
    "stopped": Stopped,
    "error": Failed,
}
_NAME_OF = {kind: name for name, kind in NAMES.items()}


def to_json(event: Event) -> dict[str, Any]:
    """The event as JSON values, its name under "event"."""
    return {"event": _NAME_OF[type(event)], **asdict(event)}


def from_json(data: Any) -> Event | None:
    """The event that `to_json` wrote; None for anything else, such as an event of a newer version. Unknown fields are ignored."""
    kind = NAMES.get(str(data.get("event"))) if isinstance(data, Mapping) else None
    if kind is None:
        return None
    hints = get_type_hints(kind)
    values = {item.name: data[item.name] for item in fields(kind) if item.name in data}
    if not all(_fits(value, hints[name]) for name, value in values.items()):
        return None
    try:
        return kind(**values)
    except TypeError:  # a field without a default is missing
        return None


def read_progress(log: Path) -> list[TrainingProgress]:
    """What the `metrics.jsonl` of a run has reported so far; none without the file. A line that a crash cut off is left out."""
    reports = []
    for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if log.is_file() else ():
        with suppress(ValueError, TypeError):
            reports.append(from_json({"event": "progress"} | parse_json(line)))
    return [report for report in reports if isinstance(report, TrainingProgress)]


def _fits(value: Any, hint: Any) -> bool:
    """Whether a JSON value is of the kind that a field wants."""
    if hint == dict[str, float]:
        return isinstance(value, dict) and all(_fits(item, float) for item in value.values())
    kinds = get_args(hint) or (hint,)
    return isinstance(value, (*kinds, int) if float in kinds else kinds) and not isinstance(value, bool)
