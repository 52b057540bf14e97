"""Where the 2D features of training frames come from."""

from degense.engine.semantics.teachers.choosing import MAKERS, TeacherChoice, default_teacher, teacher_by_name, teacher_choices
from degense.engine.semantics.teachers.precomputed import PrecomputedTeacher
from degense.engine.semantics.teachers.strokes import StrokeTeacher
from degense.engine.semantics.teachers.target_cache import CostlyTeacher, with_cached_targets
from degense.engine.semantics.teachers.teacher import LabelTeacher, Targets, Teacher

__all__ = [
    "MAKERS",
    "CostlyTeacher",
    "LabelTeacher",
    "PrecomputedTeacher",
    "StrokeTeacher",
    "Targets",
    "Teacher",
    "TeacherChoice",
    "default_teacher",
    "teacher_by_name",
    "teacher_choices",
    "with_cached_targets",
]
