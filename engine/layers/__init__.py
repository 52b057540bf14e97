"""Layers: what a pixel or a Gaussian can show, for the window and the command line alike."""

from engine.layers.layer import Layer, LayerImage, LayerRequest
from engine.layers.ranges import layer_range
from engine.layers.registry import LAYERS

__all__ = ["LAYERS", "Layer", "LayerImage", "LayerRequest", "layer_range"]
