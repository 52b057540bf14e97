"""Training: configuration, losses, density control, and the loop."""

from engine.training.config import PRESETS, TrainConfig
from engine.training.estimate import estimate
from engine.training.job import train

__all__ = ["PRESETS", "TrainConfig", "estimate", "train"]
