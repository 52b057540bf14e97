"""Measurements and experiments: benchmarks, stress, compared systems, degraded teachers. Importing it adds the teacher "degraded"."""

from degense.engine.research.degraded_teachers import degraded
from degense.engine.semantics.teachers.choosing import MAKERS

MAKERS["degraded"] = degraded
