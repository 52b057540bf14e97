"""Layers: what a pixel or a Gaussian can show, for the window and the command line alike."""

from degense.engine.layers.layer import Layer, LayerImage, LayerRequest, layer_range
from degense.engine.layers.registry import LAYERS

__all__ = ["LAYERS", "Layer", "LayerImage", "LayerRequest", "layer_range"]
