"""Losses in few kernels: Triton on a GPU, numba on the CPU. `engine.training.losses` has them in plain torch, and is their oracle."""
