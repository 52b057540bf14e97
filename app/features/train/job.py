"""What to train and how: the answers of a dialog, the words of the command line. No Qt."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from degense.engine.data.clip_options import ClipOptions
from degense.engine.errors import DegenseError, what_is_wrong

if TYPE_CHECKING:
    from degense.engine.training import TrainConfig

#: Answers about the clip (`engine.data.readers.ClipOptions`), not about the training: they are never reused for another clip.
CLIP_OPTIONS = tuple(item.name for item in fields(ClipOptions))
OF_THE_CLIP = ("clip", "out", "resume", *CLIP_OPTIONS)
#: The answers that are reused for another clip, by the kind of their values; besides them `settings`.
ANSWERS = {str: ("preset", "routing", "teacher", "device"), int: ("iterations", "max_gaussians", "seed")}
#: Settings with an option of their own, or that are none.
NAMED = ("preset", "routing", "iterations", "max_gaussians", "device", "seed", "given")
#: Options of `degense train` that take a value and whose name is the field's.
_VALUED = ("routing", "teacher", "iterations", "max_gaussians", "device", "seed", *CLIP_OPTIONS)


@dataclass(frozen=True)
class TrainingJob:
    """What to train, in the words of the command line. None leaves the choice to the preset or the clip."""

    clip: Path
    out: Path
    preset: str = "balanced"
    routing: str | None = None
    teacher: str | None = None
    iterations: int | None = None
    max_gaussians: int | None = None
    device: str | None = None
    seed: int | None = None
    resume: bool = False
    layout: str | None = None
    mask_means: str | None = None
    focal: float | None = None
    poses: str | None = None
    pose_axes: str | None = None
    labels: str | None = None
    start: int | None = None
    stride: int | None = None
    max_frames: int | None = None
    settings: tuple[tuple[str, str], ...] = ()  # further settings of `TrainConfig` by name, as JSON text

    def arguments(self) -> list[str]:
        """The command's arguments after `degense`."""
        words = ["train", str(self.clip), "--out", str(self.out), "--events", "--preset", self.preset]
        for name in _VALUED:
            value = getattr(self, name)
            if value is not None:
                words += [f"--{name.replace('_', '-')}", str(value)]
        for name, text in self.settings:
            words += ["--set", f"{name}={text}"]
        return [*words, *(("--resume",) if self.resume else ())]

    def config(self) -> TrainConfig:
        """The settings that it amounts to. DegenseError when one of them is not allowed."""
        from degense.engine.training import TrainConfig

        names = ("routing", "iterations", "max_gaussians", "device", "seed")
        return TrainConfig.preset_of(self.preset, **{name: getattr(self, name) for name in names}, **parse_settings(self.settings))

    def clip_options(self) -> dict[str, Any]:
        """What was said about the clip, as `ClipOptions` takes it."""
        return {name: value for name in CLIP_OPTIONS if (value := getattr(self, name)) is not None}

    def to_json(self) -> dict[str, Any]:
        """What is said, as JSON values; the paths in full."""
        said = {item.name: getattr(self, item.name) for item in fields(self) if getattr(self, item.name) != item.default}
        return said | {"clip": str(self.clip.resolve()), "out": str(self.out.resolve())}

    @staticmethod
    def from_json(data: Any) -> TrainingJob:
        """The job that `to_json` wrote. DegenseError when it is none."""
        from degense.engine.store.migrations import REMOVED

        kinds = get_type_hints(TrainingJob)
        try:
            values = {name: data[name] for name in data if name not in REMOVED} | {"clip": Path(data["clip"]), "out": Path(data["out"])}
            if "settings" in values:
                values["settings"] = _current(values["settings"])
                parse_settings(values["settings"])
            if wrong := [name for name, value in values.items() if name != "settings" and not isinstance(value, kinds[name])]:
                raise ValueError(f"{wrong[0]} cannot be {values[wrong[0]]!r}")
        except (KeyError, TypeError, ValueError, DegenseError) as error:
            raise DegenseError(f"A training that was kept for this start cannot be read ({what_is_wrong(error)}).") from error
        return TrainingJob(**values)

    def answers(self) -> dict[str, Any]:
        """What of it is reused for the next training."""
        return {name: value for name, value in asdict(self).items() if name not in OF_THE_CLIP}

    def with_answers(self, answers: dict[str, Any]) -> TrainingJob:
        """This job with the answers of an earlier one. Those that are no answers (of another version) are left out."""
        kinds = {name: kind for kind, names in ANSWERS.items() for name in names}
        known: dict[str, Any] = {name: value for name, value in answers.items() if name in kinds and type(value) is kinds[name]}
        settings = answers.get("settings", ())
        if isinstance(settings, list | tuple) and all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in settings):
            known["settings"] = _current(settings)
        job = replace(self, **known)
        try:
            job.config()
        except DegenseError:
            return self
        return job


def parse_settings(pairs: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    """Values of `TrainConfig` from names, of today or of an earlier version, and JSON texts.

    DegenseError when there is no such setting, or the value is of another kind.
    """
    from degense.engine.store.migrations import SETTINGS
    from degense.engine.training import TrainConfig

    defaults = {item.name: getattr(TrainConfig(), item.name) for item in fields(TrainConfig)}
    values: dict[str, Any] = {}
    for given, text in pairs:
        name = SETTINGS.get(given, given)
        if name not in defaults or name in NAMED:
            raise DegenseError(f"There is no setting {given!r}; add --set help to the command to see all.")
        values[name] = _value(name, text, defaults[name])
    return values


def _current(settings: Sequence[Sequence[Any]]) -> tuple[tuple[str, str], ...]:
    """Stored settings, without those that no longer exist."""
    from degense.engine.store.migrations import REMOVED

    return tuple((str(name), str(text)) for name, text in settings if name not in REMOVED)


def _value(name: str, text: str, default: Any) -> Any:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        value = text
    match default:
        case bool():
            right = isinstance(value, bool)
        case int():
            right = isinstance(value, int) and not isinstance(value, bool) and value >= 0
        case float():
            right = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e12
            value = float(value) if right else value
        case tuple():
            right = isinstance(value, list) and bool(value) and all(type(entry) is int and entry > 0 for entry in value)
            value = tuple(value) if right else value
        case _:
            right = isinstance(value, str)
    if not right:
        raise DegenseError(f"The setting {name} cannot be {text!r}; it is something like {json.dumps(default)}.")
    return value
