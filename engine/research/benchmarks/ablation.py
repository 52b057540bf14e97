"""The paper's own ablation against exact truth: semantic–geometric decoupling and angular distillation, each on and off.

Everything but the two is held as in the system `degensegs`: schedule, rates, targets, weights. Without decoupling the latent is a function
of the decoded deformation (routing `coupled`), as in the paper's baseline. The paper counts its decoder as part of the decoupling, so both
decoders are scored: within one of them the routing alone differs, and `threshold` without against `rnse-paper` with is the paper's reading.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

from degense.engine.field import Routing
from degense.engine.metrics.averages import mean
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
from degense.engine.research.systems import training_of
from degense.engine.training.config import TrainConfig

SCENES: tuple[PhantomScene, ...] = tuple(("family", seed) for seed in REPORT[:4])
DECODERS = ("threshold", "rnse-paper")
Variant = tuple[Routing, bool]  # decoupled (`paper`) or not (`coupled`), and angular loss
ROUTINGS: tuple[Routing, ...] = ("coupled", "paper")
VARIANTS: tuple[Variant, ...] = tuple(product(ROUTINGS, (False, True)))
Found = dict[Variant, dict[str, list[dict[str, Any]]]]  # scores of a variant on a scene, one a seed
SCENE = {
    "spurious_displacement": ("spurious, mm", 3),
    "displacement_error": ("motion error, mm", 3),
    "displacement_correlation": ("correlation", 3),
    "psnr_mask": ("PSNR, dB", 2),
}


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """What each of the four variants reaches, on each scene, and what each of the two ideas adds."""
    clips = phantoms(options, lambda fraction, words: progress(0.05 * fraction, words), SCENES)
    jobs = list(product(VARIANTS, clips, options.seeds))
    trainings = [
        BenchTraining(clips[scene], options.scratch / f"ablation-{number}", config_of(variant, options, seed), vlm_like(seed))
        for number, (variant, scene, seed) in enumerate(jobs)
    ]
    scores = score_all(trainings, options, lambda fraction, words: progress(0.05 + 0.95 * fraction, words), "trainings")
    found: Found = {variant: {scene: [] for scene in clips} for variant in VARIANTS}
    for (variant, scene, _), score in zip(jobs, scores, strict=True):
        found[variant][scene].append(score)
    yield summary(found, options)
    yield by_scene(found, options)
    yield effects(found, options)


def config_of(variant: Variant, options: BenchOptions, seed: int) -> TrainConfig:
    """The settings of `degensegs` but for the two that are in question."""
    return replace(training_of("degensegs", base_config(options, seed=seed)), routing=variant[0], angular=variant[1])


def words(options: BenchOptions) -> str:
    size = size_of(options)
    return (
        f"{len(SCENES)} phantoms of {size.frames} frames, {size.width} × {size.height}, exact depth. Each training: the system degensegs "
        f"on a budget of {size.iterations:,} steps (twice as many in all) and at most {size.gaussians:,} Gaussians, all else alike. "
        f"{TEACHER_WORDS}. Training seeds {', '.join(map(str, options.seeds))}. mIoU of prompts on held-out frames, (i − 1) % 8 == 0."
    )


NAMES = [Column("decoupled", "S-G decoupling"), Column("angular", "AASD")]


def named(variant: Variant) -> dict[str, Cell]:
    return {"decoupled": "✓" if variant[0] == "paper" else "×", "angular": "✓" if variant[1] else "×"}


def summary(found: Found, options: BenchOptions) -> Table:
    """The paper's table: one row a variant; means over all scenes, one a seed."""
    columns = [*NAMES, *(Column(d, f"mIoU {d}", 3, "mean") for d in DECODERS)]
    columns += [Column(key, heading, digits, "mean") for key, (heading, digits) in SCENE.items()]
    rows: list[dict[str, Cell]] = []
    for variant in VARIANTS:
        by_seed = list(zip(*found[variant].values(), strict=True))
        row = named(variant)
        row |= {d: [m for runs in by_seed if (m := mean(r["miou"][d] for r in runs)) is not None] for d in DECODERS}
        row |= {key: [m for runs in by_seed if (m := mean(r[key] for r in runs)) is not None] for key in SCENE}
        rows.append(row)
    return Table("ablation", "The paper's ablation, means over scenes", f"{words(options)} Mean (least–greatest) of seeds.", columns, rows)


def by_scene(found: Found, options: BenchOptions) -> Table:
    """mIoU of each variant and decoder on each scene, one a seed."""
    scenes = list(found[VARIANTS[0]])
    rows: list[dict[str, Cell]] = [
        {**named(variant), "decoder": d, **{scene: [r["miou"][d] for r in found[variant][scene]] for scene in scenes}}
        for variant in VARIANTS
        for d in DECODERS
    ]
    columns = [*NAMES, Column("decoder", "decoder"), *(Column(scene, scene, 3, "mean") for scene in scenes)]
    return Table("ablation-scenes", "The paper's ablation, mIoU on each scene", words(options), columns, rows)


def effects(found: Found, options: BenchOptions) -> Table:
    """Points of mIoU that each idea adds to what is otherwise the same: each pair has one scene and one seed."""
    without, with_ = DECODERS
    compared: list[tuple[str, Variant, str, Variant, str]] = []
    for angular, loss in ((False, "L1"), (True, "angular")):
        for one, other in ((without, without), (with_, with_), (without, with_)):
            decoders = one if one == other else f"{one} → {other}"
            compared.append((f"S-G decoupling, {loss}, {decoders}", ("coupled", angular), one, ("paper", angular), other))
    compared += [
        (f"AASD, {'decoupled' if routing == 'paper' else 'coupled'}, {d}", (routing, False), d, (routing, True), d)
        for routing in ROUTINGS
        for d in DECODERS
    ]
    rows: list[dict[str, Cell]] = []
    for name, before, decoder, after, decoder_after in compared:
        gains = [
            100 * (b["miou"][decoder_after] - a["miou"][decoder])
            for scene in found[before]
            for a, b in zip(found[before][scene], found[after][scene], strict=True)
        ]
        rows.append({"effect": name, "points": gains, "better": f"{sum(gain > 0 for gain in gains)} of {len(gains)}"})
    columns = [Column("effect", "what is added"), Column("points", "points of mIoU", 1, "mean"), Column("better", "pairs that gain")]
    text = f"{words(options)} Pairs of the same scene and seed: mean (least–greatest)."
    return Table("ablation-effects", "What decoupling and angular distillation add", text, columns, rows)
