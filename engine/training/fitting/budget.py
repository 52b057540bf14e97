"""Budgets: what a clip does not need is left out before training, and the run says so; what a training will cost."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from degense.engine.clip import Clip
from degense.engine.semantics import Basis
from degense.engine.training.config import PRESETS, TrainConfig, choose_device
from degense.engine.training.fitting.statistics import CELLS, Statistics, measure
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames

SPARE_GAUSSIANS = 3.5  # times what the pictures need: densification puts them where they are missing, not where they fit best
LEAST_GAUSSIANS = 1000
RESOLUTIONS = (16, 24, 32, 48, 64)
MARGIN = 1.2  # the planes cover the cloud and a tenth beside it
SPARE_KNOTS = 1.5
STILL_COLOUR = 6.0  # grey levels below which no colour changes in place
STILL = 0.5  # pixels of the flow below which nothing moves
VISITS = 400  # of each training frame: more teach little
LEAST_STEPS = 800  # however short the clip: the Gaussians themselves must settle
STILL_SHARE = 0.5  # of the steps are enough where nothing moves and no colour changes

# Measured with `degense train` (docs/benchmarks.md): seconds a step = overhead + per Gaussian + per pixel,
# on two laptop-class cores and on one H200.
CPU_STEP = (1e-2, 5e-6, 3e-7)
CUDA_STEP = (2e-3, 2.5e-8, 1.5e-9)
FLOW_SECONDS = 0.25  # a training frame, both ways


@dataclass(frozen=True)
class Choice:
    """One setting that a clip's own figures decided.

    Attributes
    ----------
    setting : str
        A field of `TrainConfig`, or "rank".
    preset, chosen : number, bool, tuple or None
        What the preset would have taken, and what was taken.
    why : str
        One sentence with figures.
    """

    setting: str
    preset: Any
    chosen: Any
    why: str

    @property
    def saves(self) -> bool:
        return self.chosen != self.preset

    @property
    def words(self) -> str:
        return f"{self.setting.replace('_', ' ')} {said(self.chosen)} instead of {said(self.preset)}: {self.why}"


@dataclass(frozen=True)
class Budget:
    """Every choice, the figures behind them, and the settings they lead to."""

    choices: tuple[Choice, ...]
    statistics: Statistics
    config: TrainConfig

    def to_json(self) -> dict[str, Any]:
        """For run.json: {"chosen": {setting: {preset, chosen, why}}, "statistics": {…}}."""
        chosen = {c.setting: {"preset": c.preset, "chosen": c.chosen, "why": c.why} for c in self.choices}
        return {"chosen": chosen, "statistics": {f.name: round(float(getattr(self.statistics, f.name)), 4) for f in fields(Statistics)}}

    @property
    def words(self) -> list[str]:
        """One line for each setting that became smaller than the preset's."""
        return [choice.words for choice in self.choices if choice.saves]


def said(value: Any) -> str:
    """A setting's value in words."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, Sequence):
        return ", ".join(str(item) for item in value)
    return f"{value:,}"


def fit_budget(frames: TrainingFrames, config: TrainConfig, flow: FlowSupervision | None, basis: Basis | None = None) -> Budget:
    """Settings that fit the clip: the preset's or smaller, never larger. What was given by hand (`TrainConfig.given`) stays.

    Parameters
    ----------
    flow : FlowSupervision or None
        None, for a single frame or without flow, keeps everything that motion would decide.
    basis : Basis or None
        Of the semantic latents; its rank was chosen from the singular values (`engine.semantics.fit_basis`) and is only put on record.
    """
    found = measure(frames, flow)
    chosen = [
        choice for choice in choose(found, config, len(frames.clip), len(frames.clip.train_frames)) if choice.setting not in config.given
    ]
    fitted = replace(config, **{choice.setting: choice.chosen for choice in chosen})
    coarse = config.coarse_iterations * fitted.iterations // config.iterations
    chosen.append(_coarse(config.coarse_iterations, coarse, fitted.iterations))
    fitted = replace(fitted, coarse_iterations=coarse)
    return Budget((*chosen, *([_rank(basis)] if basis is not None else [])), found, fitted)


def shortened(config: TrainConfig) -> list[str]:
    """In words, where the preset's coarse stage became shorter because fewer iterations were asked for (`TrainConfig.preset_of`)."""
    preset = PRESETS[config.preset]
    choice = _coarse(preset["coarse_iterations"], config.coarse_iterations, config.iterations)
    in_proportion = choice.chosen == preset["coarse_iterations"] * config.iterations // preset["iterations"]
    return [choice.words] if choice.saves and in_proportion and config.iterations < preset["iterations"] else []


def _coarse(asked: int, chosen: int, iterations: int) -> Choice:
    return Choice("coarse_iterations", asked, chosen, f"in proportion to {iterations:,} steps in all")


def choose(found: Statistics, config: TrainConfig, count: int, train_count: int) -> list[Choice]:
    """The choices for a clip of `count` frames, `train_count` of them trained on. Pure arithmetic."""
    needed = found.gaussians * (1 + found.unmatched)
    cap = min(config.max_gaussians, max(LEAST_GAUSSIANS, round(SPARE_GAUSSIANS * needed, -2)))
    cap_why = f"the pictures hold detail for {needed:,.0f} Gaussians, {found.unmatched:.0%} of it new after the first frame"
    return [
        Choice("max_gaussians", config.max_gaussians, int(cap), cap_why),
        *_planes(found, config),
        _times(found, config, count),
        _appearance(found, config),
        _flow(found, config),
        _iterations(found, config, train_count),
    ]


def _rank(basis: Basis) -> Choice:
    why = f"{basis.rank} directions hold {basis.energy:.2%} of what the teacher says, {basis.dimension - basis.rank} were left out"
    return Choice("rank", basis.dimension, basis.rank, why)


def _planes(found: Statistics, config: TrainConfig) -> list[Choice]:
    """The finest plane holds the change in time; finer levels are dropped where coarser ones hold it alone."""
    wanted = MARGIN * found.cells if found.cells < CELLS[-1] else math.inf  # the last stands for all that is finer
    levels = tuple(level for level in config.levels if level == min(config.levels) or wanted > config.resolution * level / 2)
    fitting = [r for r in RESOLUTIONS if r * max(levels) >= wanted]
    resolution = min(config.resolution, fitting[0] if fitting else config.resolution)
    why = f"{found.cells} cells across the picture follow motion and colour"
    return [Choice("resolution", config.resolution, resolution, why), Choice("levels", config.levels, levels, why)]


def _times(found: Statistics, config: TrainConfig, count: int) -> Choice:
    preset = config.time_resolution or max(2, (count + 1) // 2)
    chosen = min(preset, max(2, round(SPARE_KNOTS * found.knots)))
    return Choice("time_resolution", preset, chosen, f"{found.knots} moments, evenly spread, follow motion and colour")


def _appearance(found: Statistics, config: TrainConfig) -> Choice:
    needed = config.appearance and found.delta_color > STILL_COLOUR
    why = f"colours change by {found.delta_color:.1f} grey levels along their way ({STILL_COLOUR:g} can be left out)"
    return Choice("appearance", config.appearance, needed, why)


def _flow(found: Statistics, config: TrainConfig) -> Choice:
    if found.believed > 0:
        return Choice("flow", config.flow, config.flow, f"optical flow is believed in {found.believed:.0%} of the pixels")
    return Choice("flow", config.flow, 0.0, "optical flow is believed nowhere, so it has nothing to say")


def _iterations(found: Statistics, config: TrainConfig, train_count: int) -> Choice:
    still = found.believed > 0 and found.motion < STILL and found.delta_color <= STILL_COLOUR
    enough = min(config.iterations, max(LEAST_STEPS, VISITS * train_count))
    why = f"{train_count} frames to learn from" + (", in which nothing moves and no colour changes" if still else "")
    return Choice("iterations", config.iterations, round(STILL_SHARE * enough) if still else enough, why)


def estimate(clip: Clip, config: TrainConfig) -> dict[str, Any]:
    """Seconds, megabytes and words for training `clip` with `config` on its device. Order of magnitude, not a promise.

    A training that fits its budget to the clip (`config.fit`) costs this at most.

    Returns
    -------
    dict with `seconds`, `memory_mb`, `gaussians`, `words`
    """
    device = choose_device(config.device).type
    width, height = clip.size
    pixels = min(width * height, config.max_pixels)
    overhead, per_gaussian, per_pixel = CUDA_STEP if device == "cuda" else CPU_STEP
    cores = 1.0 if device == "cuda" else 2.0 / max(1, min(os.cpu_count() or 1, 8))
    gaussians = int(config.max_gaussians * 0.9)
    seconds = config.iterations * (overhead + cores * (per_gaussian * gaussians + per_pixel * pixels)) + FLOW_SECONDS * len(clip) + 5
    planes = sum(3 * (config.resolution * m) ** 2 + 3 * config.resolution * m * len(clip) // 2 for m in config.levels) * config.channels
    memory = (planes * 16 + gaussians * (14 + 32) * 16 + gaussians * 4 * 600 + pixels * 4 * 60) / 1e6
    minutes = max(1, round(seconds / 60))
    where = "the GPU" if device == "cuda" else "the processor"
    bound = "at most about" if config.fit else "about"
    words = f"{bound} {minutes} min on {where}, up to {gaussians:,} Gaussians, {memory / 1000:.1f} GB of memory beside the frames"
    return {"seconds": seconds, "memory_mb": memory, "gaussians": gaussians, "words": words}
