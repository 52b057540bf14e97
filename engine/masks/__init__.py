"""Rasterization-native semantic extraction: from a rendered frame and a text vector to a mask."""

from engine.masks.decoders import DECODERS, DEFAULT_DECODER, DEFAULT_THRESHOLD
from engine.masks.query import Maps, MaskQuery, Question, Unread, query_of
from engine.masks.superpixels import superpixels

__all__ = ["DECODERS", "DEFAULT_DECODER", "DEFAULT_THRESHOLD", "Maps", "MaskQuery", "Question", "Unread", "query_of", "superpixels"]
