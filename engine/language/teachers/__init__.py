"""Where the 2D features of training frames come from."""

from engine.language.teachers.labels import LabelTeacher
from engine.language.teachers.teacher import Targets, Teacher

__all__ = ["LabelTeacher", "Targets", "Teacher"]
