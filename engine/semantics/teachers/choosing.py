"""Which teacher a name means, and which of them a clip has what it takes for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from degense.engine.clip import Clip
from degense.engine.errors import DegenseError
from degense.engine.semantics.teachers.precomputed import PrecomputedTeacher, find_features
from degense.engine.semantics.teachers.strokes import StrokeTeacher
from degense.engine.semantics.teachers.target_cache import CostlyTeacher
from degense.engine.semantics.teachers.teacher import LabelTeacher, Teacher
from degense.engine.semantics.text.encoder import EmbeddedEncoder, TextEncoder

NO_MODEL = "a model must be named: the folder of a CLIP, SigLIP or CLIPSeg as transformers or open_clip saves it (vlm:FOLDER)"


@dataclass(frozen=True)
class TeacherChoice:
    """A teacher for a clip."""

    name: str  # as `teacher_by_name` and the command line take it
    #: Whether the clip has what it takes; else a folder must be named, as in "precomputed:FOLDER", or something must be added.
    available: bool
    reason: str  # in one line: what it would use, or what is missing


def teacher_choices(clip: Clip) -> list[TeacherChoice]:
    """All teachers that a user may choose for a clip, the best first, `none` last."""
    labelled, stroked, count = len(clip.labelled_frames), len(clip.stroked_frames), len(clip)
    choices = [
        _choice("labels", labelled, f"label maps of {labelled} of {count} frames", "no label maps: add labels/ and classes.json"),
        _choice("strokes", stroked, f"strokes on {stroked} of {count} frames", "no strokes: draw some, or add strokes/ and classes.json"),
    ]
    try:
        choices.append(TeacherChoice("precomputed", True, f"features in {find_features(clip).name}/ beside the clip"))
    except DegenseError as error:
        choices.append(TeacherChoice("precomputed", False, str(error)))
    choices.append(TeacherChoice("vlm", False, NO_MODEL))
    return [*choices, TeacherChoice("none", True, "geometry only: nothing can be prompted")]


def default_teacher(clip: Clip) -> str:
    """`labels` when the clip has any label map, `strokes` when it has scribbles, else `none`."""
    return "labels" if clip.labelled_frames else "strokes" if clip.stroked_frames else "none"


def _choice(name: str, count: int, there: str, missing: str) -> TeacherChoice:
    return TeacherChoice(name, count > 0, there if count else missing)


def teacher_by_name(name: str, clip: Clip, encoder: TextEncoder | None = None) -> Teacher | CostlyTeacher:
    """The teacher called `name` for a clip; `with_cached_targets` runs a costly one.

    "labels"; "strokes"; "precomputed" or "precomputed:FOLDER?level=0"; "vlm:FOLDER?scales=1&regions=FOLDER"; and what is in `MAKERS`.
    Teachers that know classes by name give them the vectors of `encoder`, by default the embedded one. Features of a model bring their own.
    DegenseError for an unknown name, an encoder that the teacher cannot take, and when the clip lacks what the teacher needs.
    """
    kind, _, how = name.partition(":")
    if kind not in MAKERS or (how and kind in ("labels", "strokes")):
        raise DegenseError(f"there is no teacher {name!r}; choose {', '.join(MAKERS)} or none")
    if encoder is not None and kind in ("precomputed", "vlm"):
        raise DegenseError(f"features of the teacher {kind} bring their own text vectors, so no other encoder can be chosen")
    return MAKERS[kind](name, clip, encoder or EmbeddedEncoder())


def _precomputed(name: str, clip: Clip, encoder: TextEncoder) -> Teacher:
    place, values = _place(name, {"level": 0})
    return PrecomputedTeacher(clip, Path(place).expanduser() if place else find_features(clip), values["level"])


def _vlm(name: str, clip: Clip, encoder: TextEncoder) -> CostlyTeacher:
    model, values = _place(name, {"scales": 1, "regions": ""})
    if not model:
        raise DegenseError(NO_MODEL)
    from degense.engine.semantics.teachers.vlm import VlmTeacher

    return VlmTeacher(clip, model, values["scales"], values["regions"])


def _place(name: str, defaults: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Folder, maybe empty, and options of "KIND:FOLDER?name=number&name=folder", each of the type of its default."""
    _, _, how = name.partition(":")
    folder, _, options = how.partition("?")
    values = dict(defaults)
    for word in filter(None, options.split("&")):
        key, _, value = word.partition("=")
        if key not in defaults or not value or (isinstance(defaults[key], int) and not value.isdecimal()):
            raise DegenseError(f"the teacher {name!r} does not understand {word!r}: say name=value, of {', '.join(defaults)}")
        values[key] = type(defaults[key])(value)
    return folder, values


#: What makes a teacher of its whole name, by its kind. Experiments add their own.
MAKERS: dict[str, Callable[[str, Clip, TextEncoder], Teacher | CostlyTeacher]] = {
    "labels": lambda name, clip, encoder: LabelTeacher(clip, encoder),
    "strokes": lambda name, clip, encoder: StrokeTeacher(clip, encoder),
    "precomputed": _precomputed,
    "vlm": _vlm,
}
