"""What is kept on disk: run folders, tensors, PLY."""

from degense.engine.store.run import Run

__all__ = ["Run"]
