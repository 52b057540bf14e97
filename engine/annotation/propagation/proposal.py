"""A label map that came from other frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from degense.engine.annotation.packed import unpack


@dataclass(frozen=True)
class Carried:
    """A proposal.

    Attributes
    ----------
    packed : bytes
        The map, see `engine.annotation.packed`.
    shape : (height, width)
    confidence : float
        In [0, 1]: the expected intersection over union, averaged over the classes in the map.
    """

    packed: bytes
    shape: tuple[int, int]
    confidence: float

    @property
    def labels(self) -> np.ndarray:
        """uint8 [H, W]."""
        return unpack(self.packed, self.shape)
