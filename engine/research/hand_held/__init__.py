"""Long clips of a hand-held camera with one labelled frame: what a scene, and what carrying, make of it."""

from degense.engine.research.hand_held.tables import run

__all__ = ["run"]
