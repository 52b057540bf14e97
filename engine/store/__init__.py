"""What is kept on disk: run folders, tensors, PLY."""

from engine.store.run import Run

__all__ = ["Run"]
