"""Every part in which the default differs from the paper, taken away alone: what it costs on surgeries of the set `report`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import Any

from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.trainings import (
    TEACHER_WORDS,
    BenchTraining,
    PhantomScene,
    base_config,
    phantoms,
    score_all,
    size_of,
    vlm_like,
)
from degense.engine.research.surgeries import REPORT
from degense.engine.research.sweep.tables import relative
from degense.engine.semantics.prompts import DECODERS, DEFAULT_DECODER

Scores = dict[str, Any]

SCENES: tuple[PhantomScene, ...] = tuple(("family", seed) for seed in REPORT[:4])
DEFAULT = "default"
#: Part of the default → the settings that take it away, as `degense train --set` and `--routing` know them.
PARTS: dict[str, dict[str, Any]] = {
    "routing isolated": {"routing": "paper"},
    "decoupled latents": {"routing": "coupled", "angular": True},
    "back-projection before distillation": {"lift": False},
    "guided upsampling": {"guided": False},
    "consensus over time": {"consensus": False},
    "angular loss": {"angular": False},
    "weights of rare classes": {"rarity": False},
    "rectified states": {"linear_states": True},
    "appearance branch and colour residuals": {"appearance": False},
    "optical flow": {"flow": 0.0},
    "measured depth": {"depth": 0.0},
    "no flow where the look changes": {"flow_constancy": False},
    "flow by its precision": {"flow_precision": False},
    "depth by its precision": {"depth_precision": False},
    "depth of all frames together": {"depth_together": False},
    "inferred motion of changed tissue": {"flow_inference": False},
    "rest where flow tells no motion": {"stillness": False},
    "rigidity": {"rigidity": 0.0},
    "small displacements": {"displacement": 0.0},
    "small changes of shape": {"shape": 0.0},
    "smooth planes": {"plane_space": 0.0, "plane_time": 0.0, "plane_static": 0.0},
    "transient Gaussians": {"persistent": True},
    "velocities of transient Gaussians": {"velocities": False},
    "coarse stage on one frame": {"coarse_frames": "all"},
    "planes at a rate of their own": {"rate_planes": 1.6e-3},
}


#: Column → its heading, how it is read, whether more is better.
SCORES: dict[str, tuple[str, Callable[[Scores], float | None], bool]] = {
    "miou": ("mIoU", lambda scores: scores["miou"][DEFAULT_DECODER], True),
    "psnr": ("PSNR, dB", lambda scores: scores["psnr_mask"], True),
    "error": ("motion error", relative("displacement_error"), False),
    "charred": ("false motion, charred", relative("spurious_displacement_static"), False),
    "static": ("false motion elsewhere", relative("false_motion"), False),
}


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """The default, and what each score loses when one part is taken away; then the decoders."""
    clips = phantoms(options, lambda fraction, words: progress(0.05 * fraction, words), SCENES)
    jobs = list(product((DEFAULT, *PARTS), clips, options.seeds))
    trainings = [
        BenchTraining(
            clips[scene], options.scratch / f"parts-{number}", base_config(options, seed=seed, **PARTS.get(part, {})), vlm_like(seed)
        )
        for number, (part, scene, seed) in enumerate(jobs)
    ]
    scores = score_all(trainings, options, lambda fraction, words: progress(0.05 + 0.95 * fraction, words), "trainings")
    found: dict[str, list[Scores]] = {part: [] for part in (DEFAULT, *PARTS)}
    for (part, _, _), score in zip(jobs, scores, strict=True):
        found[part].append(score)
    yield parts(found, options)
    yield decoders(found[DEFAULT], options)


def parts(found: dict[str, list[Scores]], options: BenchOptions) -> Table:
    """Pair by pair of the same scene and seed: the score without a part, less the default's."""
    pairs = len(found[DEFAULT])
    columns = [Column("part", "taken away"), Column("switch", "switch")]
    rows: list[dict[str, Cell]] = [{"part": f"nothing: {DEFAULT}"}]
    for key, (heading, read, _) in SCORES.items():
        columns += [Column(key, heading, 3, "mean"), Column(f"{key} worse", f"worse, of {pairs}")]
        rows[0][key] = _known(map(read, found[DEFAULT]))
    for part, settings in PARTS.items():
        row: dict[str, Cell] = {"part": part, "switch": " ".join(f"`{name}={_typed(value)}`" for name, value in settings.items())}
        for key, (_, read, larger) in SCORES.items():
            both = ((read(without), read(default)) for without, default in zip(found[part], found[DEFAULT], strict=True))
            changes = [one - other for one, other in both if one is not None and other is not None]
            row |= {key: changes, f"{key} worse": str(sum((change < 0) == larger and change != 0 for change in changes))}
        rows.append(row)
    return Table(
        "parts", "The default less one part at a time", f"{_words(options)} Rows but the first: change against the default.", columns, rows
    )


def decoders(scores: list[Scores], options: BenchOptions) -> Table:
    """mIoU of the default's latents by each decoder."""
    rows: list[dict[str, Cell]] = [{"decoder": name, "miou": [score["miou"][name] for score in scores]} for name in DECODERS]
    return Table(
        "parts-decoders",
        "Decoders on the default",
        _words(options),
        [Column("decoder", "decoder"), Column("miou", "mIoU", 3, "mean")],
        rows,
    )


def _known(values: Iterator[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _typed(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def _words(options: BenchOptions) -> str:
    size = size_of(options)
    return (
        f"Surgeries {', '.join(str(seed) for _, seed in SCENES)} of the set report, {size.frames} frames, {size.width} × {size.height}, "
        f"exact depth. Preset quick with {size.iterations:,} steps and at most {size.gaussians:,} Gaussians. {TEACHER_WORDS}. "
        f"Training seeds {', '.join(map(str, options.seeds))}. mIoU of prompts by {DEFAULT_DECODER}, held-out frames; motion as a share of "
        "the mean true motion, all frames. Mean (least–greatest) over scenes and seeds."
    )
