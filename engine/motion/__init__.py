"""Motion seen in images, motion of the model, and the difference between them."""

from degense.engine.motion.flow import chain, confidence, consistent, flow_between, flow_error, follow, normalized, sample, steps_between
from degense.engine.motion.observed import displacement

__all__ = [
    "chain",
    "confidence",
    "consistent",
    "displacement",
    "flow_between",
    "flow_error",
    "follow",
    "normalized",
    "sample",
    "steps_between",
]
