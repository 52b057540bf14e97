"""What a training will cost, before it begins."""

from __future__ import annotations

import os
from typing import Any

from degense.engine.clip import Clip
from degense.engine.training.config import TrainConfig, choose_device

# Measured with `degense train` (docs/benchmarks.md): seconds a step = overhead + per Gaussian + per pixel,
# on two laptop-class cores and on one H200.
CPU_STEP = (1e-2, 5e-6, 3e-7)
CUDA_STEP = (2e-3, 2.5e-8, 1.5e-9)
FLOW_SECONDS = 0.25  # a training frame, both ways


def estimate(clip: Clip, config: TrainConfig) -> dict[str, Any]:
    """Seconds, megabytes and words for training `clip` with `config` on its device. Order of magnitude, not a promise.

    The keys are `seconds`, `memory_mb`, `gaussians` and `words`.
    """
    device = choose_device(config.device).type
    width, height = clip.size
    pixels = min(width * height, config.max_pixels)
    overhead, per_gaussian, per_pixel = CUDA_STEP if device == "cuda" else CPU_STEP
    cores = 1.0 if device == "cuda" else 2.0 / max(1, min(os.cpu_count() or 1, 8))
    gaussians = config.max_gaussians
    seconds = config.iterations * (overhead + cores * (per_gaussian * gaussians + per_pixel * pixels)) + FLOW_SECONDS * len(clip) + 5
    planes = sum(3 * (config.resolution * m) ** 2 + 3 * config.resolution * m * len(clip) // 2 for m in config.levels) * config.channels
    memory = (planes * 16 + gaussians * (14 + 32) * 16 + gaussians * 4 * 600 + pixels * 4 * 60) / 1e6
    minutes = max(1, round(seconds / 60))
    where = "the GPU" if device == "cuda" else "the processor"
    words = f"about {minutes} min on {where}, up to {gaussians:,} Gaussians, {memory / 1000:.1f} GB of memory beside the frames"
    return {"seconds": seconds, "memory_mb": memory, "gaussians": gaussians, "words": words}
