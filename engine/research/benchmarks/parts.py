"""Parts of the default against exact truth: routing × angular loss × appearance branch × decoder, with a teacher like a VLM."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

from degense.engine.field import ROUTINGS
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.trainings import TEACHER_WORDS, BenchTraining, base_config, phantoms, protocol, score_all, vlm_like
from degense.engine.semantics.prompts import DECODERS, DEFAULT_DECODER
from degense.engine.training.config import TrainConfig

Variant = tuple[str, bool, bool]  # routing, angular loss, appearance branch
Found = dict[Variant | str, list[dict[str, Any]]]  # scores of a variant, or of one of `OTHERS`, one a seed
VARIANTS: list[Variant] = [*product(ROUTINGS, (True, False), (True, False))]
BASELINE: Variant = ("coupled", False, False)
#: The baseline as peers train its semantics: on the teacher's patches as they are.
PEERS: dict[str, Any] = {"routing": "coupled", "angular": False, "appearance": False, "guided": False}
#: Beside the grid: other parts of the default, taken away alone, and the baseline as peers train it, its motion too.
OTHERS: dict[str, dict[str, Any]] = {
    "semantics from nothing, without back-projection": {"lift": False},
    "teacher's patches as they are": {"guided": False},
    "baseline: coupled, L1, no Ψ_app, patches as they are": PEERS,
    "baseline, and no flow supervision": PEERS | {"flow": 0.0, "velocities": False},
}
SCENE = {
    "spurious_displacement": ("spurious, mm", 3),
    "spurious_displacement_revealed": ("… not marked as a guess", 3),
    "displacement_error": ("motion error, mm", 3),
    "displacement_correlation": ("correlation", 3),
    "recovered_share": ("recovered share", 3),
    "psnr_mask": ("PSNR, dB", 2),
    "ssim": ("SSIM", 3),
    "train_seconds": ("training, s", 0),
}


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """For each phantom: what each variant reaches, each class's IoU, and single parts taken from the default."""
    clips = phantoms(options, lambda fraction, words: progress(0.03 * fraction, words))
    for number, (kind, clip) in enumerate(clips.items()):
        trainings = [
            BenchTraining(
                clip,
                options.scratch / f"parts-{kind}-{i}-{seed}",
                base_config(options, seed=seed, routing=variant[0], angular=variant[1], appearance=variant[2]),
                vlm_like(seed),
            )
            for i, variant in enumerate(VARIANTS)
            for seed in options.seeds
        ]
        trainings += [
            BenchTraining(
                clip,
                options.scratch / f"parts-{kind}-other-{i}-{seed}",
                base_config(options, seed=seed, **changes),
                vlm_like(seed),
            )
            for i, changes in enumerate(OTHERS.values())
            for seed in options.seeds
        ]

        def tell(fraction: float, words: str, n: int = number) -> None:
            progress(0.03 + 0.97 * (n + fraction) / len(clips), words)

        scores = score_all(trainings, options, tell, f"{kind}: trainings")
        count = len(options.seeds)
        names: list[Variant | str] = [*VARIANTS, *OTHERS]
        found: Found = {name: scores[i * count : (i + 1) * count] for i, name in enumerate(names)}
        yield summary(kind, found, options)
        yield per_class(kind, found, options)
        yield parts(kind, found, options)


def words_of(variant: Variant) -> dict[str, Cell]:
    routing, angular, appearance = variant
    return {"routing": routing, "loss": "angular" if angular else "L1", "appearance": "on" if appearance else "off"}


NAMES = [Column("routing", "routing"), Column("loss", "loss"), Column("appearance", "Ψ_app")]


def summary(kind: str, found: Found, options: BenchOptions) -> Table:
    """One row a training: masks by every decoder, false motion, motion, pictures."""
    columns = [*NAMES, *(Column(f"miou {d}", f"mIoU {d}", 3, "mean") for d in DECODERS)]
    columns += [Column(f"boundary {d}", f"boundary F {d}", 3, "mean") for d in DECODERS]
    columns += [Column(key, heading, digits, "mean") for key, (heading, digits) in SCENE.items()]
    rows: list[dict[str, Cell]] = []
    for variant in VARIANTS:
        runs, row = found[variant], words_of(variant)
        for d in DECODERS:
            row[f"miou {d}"] = [r["miou"][d] for r in runs]
            row[f"boundary {d}"] = [r["masks"][d]["boundary_f"] for r in runs]
        row |= {key: [r[key] for r in runs if r[key] is not None] for key in SCENE}
        rows.append(row)
    any_run = found[BASELINE][0]
    floor = [value for value in any_run["masks"][DECODERS[0]]["floor"].values() if value is not None]
    rows.append(
        {"routing": "floor: one class everywhere, nothing moves", "psnr_mask": None}
        | {f"miou {d}": sum(floor) / len(floor) for d in DECODERS}
        | {"displacement_error": any_run["true_displacement"], "spurious_displacement": 0.0, "recovered_share": 0.0}
    )
    return Table(f"parts-{kind}", f"Routing, loss and appearance, phantom “{kind}”", f"{protocol(options)} {TEACHER_WORDS}.", columns, rows)


def per_class(kind: str, found: Found, options: BenchOptions) -> Table:
    """IoU of every class by every variant and decoder; instruments last."""
    classes = list(found[BASELINE][0]["masks"][DECODERS[0]]["iou"])
    rows: list[dict[str, Cell]] = []
    for variant in VARIANTS:
        runs = found[variant]
        for d in DECODERS:
            ious = {c: [r["masks"][d]["iou"][c] for r in runs if r["masks"][d]["iou"][c] is not None] for c in classes}
            rows.append(words_of(variant) | {"decoder": d, "miou": [r["miou"][d] for r in runs]} | ious)
    rows.append({"routing": "floor: everywhere"} | {c: found[BASELINE][0]["masks"][DECODERS[0]]["floor"][c] for c in classes})
    columns = [
        *NAMES,
        Column("decoder", "decoder"),
        Column("miou", "mIoU", 3, "mean"),
        *(Column(c, c, 3, "mean") for c in classes),
    ]
    title = f"IoU of each class, phantom “{kind}”"
    return Table(f"parts-{kind}-classes", title, f"{protocol(options)} {TEACHER_WORDS}.", columns, rows)


def parts(kind: str, found: Found, options: BenchOptions) -> Table:
    """The default, the default less one part at a time, and the baseline."""
    config = TrainConfig()
    default: Variant = (config.routing, config.angular, config.appearance)
    others = [routing for routing in ROUTINGS if routing != config.routing]
    chosen: list[tuple[str, Variant | str, str]] = [("default", default, DEFAULT_DECODER)]
    chosen += [(f"routing {routing}", (routing, *default[1:]), DEFAULT_DECODER) for routing in others]
    chosen.append((f"{'L1' if default[1] else 'angular'} loss", (default[0], not default[1], default[2]), DEFAULT_DECODER))
    chosen.append((f"Ψ_app {'off' if default[2] else 'on'}", (*default[:2], not default[2]), DEFAULT_DECODER))
    chosen += [(f"decoder {d}", default, d) for d in DECODERS if d != DEFAULT_DECODER]
    chosen += [(name, name, "threshold" if name.startswith("baseline") else DEFAULT_DECODER) for name in OTHERS]
    chosen.append(("coupled, L1, no Ψ_app, threshold", BASELINE, "threshold"))
    best = [r["miou"][DEFAULT_DECODER] for r in found[default]]
    rows: list[dict[str, Cell]] = [
        {
            "part": name,
            "miou": [r["miou"][d] for r in found[variant]],
            "gap": [100 * (b - r["miou"][d]) for b, r in zip(best, found[variant], strict=True)],
            "spurious": [r["spurious_displacement"] for r in found[variant]],
            "correlation": [r["displacement_correlation"] for r in found[variant] if r["displacement_correlation"] is not None],
        }
        for name, variant, d in chosen
    ]
    return Table(
        f"parts-{kind}-default",
        f"The default less one part at a time, phantom “{kind}”",
        f"{protocol(options)} {TEACHER_WORDS}. Gaps are seed by seed.",
        [
            Column("part", "what is changed"),
            Column("miou", "mIoU", 3, "mean"),
            Column("gap", "points below the default", 1, "mean"),
            Column("spurious", "spurious, mm", 3, "mean"),
            Column("correlation", "correlation", 3, "mean"),
        ],
        rows,
    )
