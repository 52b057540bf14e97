"""The tiny runs of the layers' tests."""

from tests.layers.conftest import clip, lonely, scene, speechless  # noqa: F401
