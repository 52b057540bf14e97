"""Synthetic surgery with exact truth: colour, depth, label and displacement of every pixel."""

from degense.engine.data.synthetic.clip import PhantomOptions, make_phantom

__all__ = ["PhantomOptions", "make_phantom"]
