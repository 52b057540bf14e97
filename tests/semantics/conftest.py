"""The tiny run of the layers' tests."""

from tests.layers.conftest import clip, scene  # noqa: F401
