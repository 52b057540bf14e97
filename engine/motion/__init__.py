"""Motion seen in images, motion of the model, and the difference between them."""

from engine.motion.flow import chain, confidence, consistent, flow_between, sample
from engine.motion.warp import displacement, model_flow, spurious

__all__ = ["chain", "confidence", "consistent", "displacement", "flow_between", "model_flow", "sample", "spurious"]
