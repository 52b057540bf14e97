"""Label maps made and corrected by hand, and carried through time."""

from engine.annotation.propagation import Carried, propagate

__all__ = ["Carried", "propagate"]
