"""Where the 2D features of training frames come from."""

from engine.clip import Clip
from engine.errors import DegenseError
from engine.language.encoder import EmbeddedEncoder
from engine.language.teachers.labels import LabelTeacher
from engine.language.teachers.teacher import Targets, Teacher

TEACHERS = ("labels",)

__all__ = ["TEACHERS", "LabelTeacher", "Targets", "Teacher", "teacher_by_name"]


def teacher_by_name(name: str, clip: Clip) -> Teacher:
    """The teacher called `name` for a clip, with the embedded encoder. DegenseError for an unknown name."""
    if name not in TEACHERS:
        raise DegenseError(f"there is no teacher {name!r}; choose {', '.join(TEACHERS)} or none")
    return LabelTeacher(clip, EmbeddedEncoder())
