"""Measurements and experiments: benchmarks, stress, compared systems, degraded teachers.

Importing it adds the teachers "degraded" and "unseen", and the distillation "clusters".
"""

from degense.engine.research.codebook import fit_codebook
from degense.engine.research.degraded_teachers import degraded
from degense.engine.research.unseen_teacher import UnseenTeacher
from degense.engine.semantics.teachers.choosing import MAKERS
from degense.engine.training.semantic.distillation import DISTILLATIONS

MAKERS["degraded"] = degraded
MAKERS["unseen"] = UnseenTeacher
DISTILLATIONS["clusters"] = fit_codebook
