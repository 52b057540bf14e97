"""A trained run, ready to be looked at: its states in time, its renders, and the masks of prompts."""

from degense.engine.scene.scene import NO_SUPPORT, REVEALED, Scene

__all__ = ["NO_SUPPORT", "REVEALED", "Scene"]
