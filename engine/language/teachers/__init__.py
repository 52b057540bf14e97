"""Where the 2D features of training frames come from."""

from engine.language.teachers.choosing import TEACHERS, TeacherChoice, default_teacher, teacher_by_name, teacher_choices
from engine.language.teachers.degraded import VLM_LIKE, Degradation, DegradedTeacher
from engine.language.teachers.labels import LabelTeacher
from engine.language.teachers.precomputed import PrecomputedTeacher
from engine.language.teachers.store import CostlyTeacher, answered
from engine.language.teachers.strokes import StrokeTeacher
from engine.language.teachers.teacher import Targets, Teacher

__all__ = [
    "TEACHERS",
    "VLM_LIKE",
    "CostlyTeacher",
    "Degradation",
    "DegradedTeacher",
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
