"""Rasterization-native semantic extraction: from a rendered frame and a text vector to a mask."""

from degense.engine.semantics.masks.decode import Decoded, decode
from degense.engine.semantics.masks.query import FrameSemantics, PendingMasks, query_of
from degense.engine.semantics.masks.superpixels import superpixels

__all__ = ["Decoded", "FrameSemantics", "PendingMasks", "decode", "query_of", "superpixels"]
