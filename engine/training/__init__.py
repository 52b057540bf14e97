"""Training: configuration, losses, density control, and the loop."""

from degense.engine.training.config import PRESETS, TrainConfig
from degense.engine.training.cost import estimate
from degense.engine.training.job import train

__all__ = ["PRESETS", "TrainConfig", "estimate", "train"]
