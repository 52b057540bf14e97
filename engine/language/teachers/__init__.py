"""Where the 2D features of training frames come from."""

from engine.clip import Clip
from engine.errors import DegenseError
from engine.language.embedded import EmbeddedEncoder
from engine.language.teachers.degraded import VLM_LIKE, Degradation, DegradedTeacher
from engine.language.teachers.labels import LabelTeacher
from engine.language.teachers.store import CostlyTeacher, answered
from engine.language.teachers.strokes import StrokeTeacher
from engine.language.teachers.teacher import Targets, Teacher

TEACHERS = ("labels", "strokes", "degraded")

__all__ = [
    "TEACHERS",
    "VLM_LIKE",
    "CostlyTeacher",
    "Degradation",
    "DegradedTeacher",
    "LabelTeacher",
    "StrokeTeacher",
    "Targets",
    "Teacher",
    "answered",
    "teacher_by_name",
]


def teacher_by_name(name: str, clip: Clip) -> Teacher | CostlyTeacher:
    """The teacher called `name` for a clip, with the embedded encoder; `answered` makes a costly one speak.

    "labels"; "strokes"; or "degraded", the labels made as unreliable as a vision-language model, possibly with its strength:
    "degraded:patches=24,noise=0.5,confusion=0.15,flicker=0.1,seed=0". DegenseError for an unknown name.
    """
    kind, _, how = name.partition(":")
    if kind not in TEACHERS or (how and kind in ("labels", "strokes")):
        raise DegenseError(f"there is no teacher {name!r}; choose {', '.join(TEACHERS)} or none")
    if kind == "strokes":
        return StrokeTeacher(clip, EmbeddedEncoder())
    labels = LabelTeacher(clip, EmbeddedEncoder())
    return labels if kind == "labels" else DegradedTeacher(labels, Degradation.parse(how))
