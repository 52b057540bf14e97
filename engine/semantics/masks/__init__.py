"""Rasterization-native semantic extraction: from a rendered frame and a text vector to a mask."""

from degense.engine.semantics.masks.decoders import DECODERS, DEFAULT_DECODER, DEFAULT_THRESHOLD
from degense.engine.semantics.masks.query import FrameSemantics, Maps, PendingMaps, Question, query_of
from degense.engine.semantics.masks.superpixels import superpixels

__all__ = [
    "DECODERS",
    "DEFAULT_DECODER",
    "DEFAULT_THRESHOLD",
    "FrameSemantics",
    "Maps",
    "PendingMaps",
    "Question",
    "query_of",
    "superpixels",
]
