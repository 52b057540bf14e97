"""Measurements and experiments: benchmarks, stress, compared systems, degraded teachers.

Importing it adds the teacher "degraded" and the distillation "clusters".
"""

from degense.engine.research.codebook import fit_codebook
from degense.engine.research.degraded_teachers import degraded
from degense.engine.semantics.teachers.choosing import MAKERS
from degense.engine.training.semantic.distillation import DISTILLATIONS

MAKERS["degraded"] = degraded
DISTILLATIONS["clusters"] = fit_codebook
