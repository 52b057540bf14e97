"""Synthetic surgery with exact truth: colour, depth, label, displacement and tracks."""

from degense.engine.data.synthetic.clip import PhantomOptions, make_phantom

__all__ = ["PhantomOptions", "make_phantom"]
