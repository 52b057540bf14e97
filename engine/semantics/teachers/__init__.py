"""Where the 2D features of training frames come from."""

from degense.engine.semantics.teachers.answer_store import CostlyTeacher, answered
from degense.engine.semantics.teachers.choosing import MAKERS, TeacherChoice, default_teacher, teacher_by_name, teacher_choices
from degense.engine.semantics.teachers.labels import LabelTeacher
from degense.engine.semantics.teachers.precomputed import PrecomputedTeacher
from degense.engine.semantics.teachers.strokes import StrokeTeacher
from degense.engine.semantics.teachers.teacher import Targets, Teacher

__all__ = [
    "MAKERS",
    "CostlyTeacher",
    "LabelTeacher",
    "PrecomputedTeacher",
    "StrokeTeacher",
    "Targets",
    "Teacher",
    "TeacherChoice",
    "answered",
    "default_teacher",
    "teacher_by_name",
    "teacher_choices",
]
