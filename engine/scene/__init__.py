"""A trained run, ready to be looked at: its states in time, its renders, and the masks of prompts."""

from degense.engine.scene.renderer import NO_OBSERVABILITY
from degense.engine.scene.scene import Scene
from degense.engine.scene.uncertainty import REVEALED

__all__ = ["NO_OBSERVABILITY", "REVEALED", "Scene"]
