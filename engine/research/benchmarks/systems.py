"""The systems that the paper compares, with a teacher like a VLM: each with its own best decoder, instruments included."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from degense.engine.metrics.averages import mean
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.baseline_rows import add_baselines, baselines_of
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.trainings import TEACHER_WORDS, BenchTraining, base_config, phantoms, protocol, score_all, vlm_like
from degense.engine.research.systems import SYSTEMS, as_system
from degense.engine.semantics.prompts import DECODERS
from degense.engine.vocabulary import instruments

OURS = "degense"
#: Columns of `summary` that baselines have too: the key of their score, and whether larger is better.
COMPARED = {
    "miou": ("miou", True),
    "boundary": ("boundary_f", True),
    "psnr_mask": ("psnr_mask", True),
    "displacement_error": ("displacement_error", False),
    "displacement_correlation": ("displacement_correlation", True),
    "recovered_share": ("recovered_share", True),
}
Found = dict[str, list[dict[str, Any]]]  # system → scores, one a seed


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """For each phantom: what each system reaches, and each class's IoU; at last, how far ours lies above each."""
    clips = phantoms(options, lambda fraction, words: progress(0.03 * fraction, words))
    by_kind: dict[str, Found] = {}
    for number, (kind, clip) in enumerate(clips.items()):
        trainings = [
            BenchTraining(
                clip,
                options.scratch / f"systems-{kind}-{name}-{seed}",
                as_system(name, base_config(options, seed=seed)),
                vlm_like(seed),
            )
            for name in SYSTEMS
            for seed in options.seeds
        ]

        def tell(fraction: float, words: str, n: int = number) -> None:
            progress(0.03 + 0.97 * (n + fraction) / len(clips), words)

        scores = score_all(trainings, options, tell, f"{kind}: trainings")
        count = len(options.seeds)
        by_kind[kind] = {name: scores[i * count : (i + 1) * count] for i, name in enumerate(SYSTEMS)}
        teachers = [vlm_like(seed) for seed in options.seeds]
        found = summary(kind, by_kind[kind], options)
        add_baselines(found, baselines_of(clip, teachers, silent), COMPARED)
        yield found
        yield per_class(kind, by_kind[kind], options)
    yield margins(by_kind, options)


def best_decoder(runs: list[dict[str, Any]]) -> str:
    """The decoder with the largest mIoU over all seeds of a system."""
    return max(DECODERS, key=lambda decoder: sum(r["miou"][decoder] or 0.0 for r in runs))


def of_instruments(iou: dict[str, float | None]) -> float | None:
    """Mean IoU of the classes that are instruments."""
    values = list(iou.values())
    return mean(values[index] for index in instruments(tuple(iou)))


def words(options: BenchOptions) -> str:
    return (
        f"{protocol(options)} The preset's full budget for all systems. {TEACHER_WORDS}, the same words for all systems. What each "
        "keeps of its original: engine/systems.py. "
        "mIoU: each with its own best decoder, chosen on the scored frames."
    )


def summary(kind: str, found: Found, options: BenchOptions) -> Table:
    """One row a system."""
    columns = [
        Column("system", "system"),
        Column("decoder", "own best decoder"),
        Column("miou", "mIoU", 3, "mean"),
        Column("instruments", "instruments", 3, "mean"),
        Column("pairs", "mIoU, all pairs", 3, "mean"),
        Column("boundary", "boundary F", 3, "mean"),
        Column("flicker", "flicker, %", 2, "mean"),
        Column("false", "frames with a class that is absent", 1, "mean"),
        *(Column(f"miou {d}", f"mIoU {d}", 3, "mean") for d in DECODERS),
        Column("psnr_mask", "PSNR, dB", 2, "mean"),
        Column("spurious_displacement", "spurious, mm", 3, "mean"),
        Column("false_motion", "false motion, mm", 3, "mean"),
        Column("displacement_error", "motion error, mm", 3, "mean"),
        Column("displacement_correlation", "correlation", 3, "mean"),
        Column("recovered_share", "recovered share", 3, "mean"),
        Column("train_seconds", "training, s", 0, "mean"),
    ]
    rows: list[dict[str, Cell]] = []
    for name, runs in found.items():
        decoder = best_decoder(runs)
        masks = [r["masks"][decoder] for r in runs]
        row: dict[str, Cell] = {"system": name, "decoder": decoder}
        row |= {"miou": [m["miou"] for m in masks], "pairs": [m["miou_pairs"] for m in masks], "boundary": [m["boundary_f"] for m in masks]}
        row["instruments"] = _known(of_instruments(m["iou"]) for m in masks)
        row["flicker"] = [100 * value for value in _known(r["flicker"][decoder] for r in runs)]
        row["false"] = [float(sum(false["frames"] for false in m["false_positives"].values())) for m in masks]
        row |= {f"miou {d}": [r["miou"][d] for r in runs] for d in DECODERS}
        row |= {c.key: _known(r[c.key] for r in runs) for c in columns[-7:]}
        rows.append(row)
    floor = found[OURS][0]["masks"][DECODERS[0]]["floor_answer"]
    rows.append({"system": f"floor: all is {floor['class']}", "miou": floor["miou"], "pairs": floor["miou_pairs"], "instruments": 0.0})
    return Table(f"systems-{kind}", f"Systems, phantom “{kind}”", words(options), columns, rows)


def per_class(kind: str, found: Found, options: BenchOptions) -> Table:
    """The paper's form: systems × classes, and their mean."""
    classes = list(found[OURS][0]["masks"][DECODERS[0]]["iou"])
    columns = [
        Column("system", "system"),
        Column("decoder", "own best decoder"),
        *(Column(c, c, 3, "mean") for c in classes),
    ]
    columns.append(Column("mean", "mean", 3, "mean"))
    rows: list[dict[str, Cell]] = []
    for name, runs in found.items():
        decoder = best_decoder(runs)
        ious = [r["masks"][decoder]["iou"] for r in runs]
        row: dict[str, Cell] = {"system": name, "decoder": decoder, "mean": [r["miou"][decoder] for r in runs]}
        rows.append(row | {c: _known(iou[c] for iou in ious) for c in classes})
    title = f"IoU of each class by each system, phantom “{kind}”"
    return Table(f"systems-{kind}-classes", title, words(options), columns, rows)


def margins(by_kind: dict[str, Found], options: BenchOptions) -> Table:
    """Points by which ours lies above each other system, seed by seed."""
    columns = [Column("system", "above")]
    rows: list[dict[str, Cell]] = [{"system": name} for name in SYSTEMS if name != OURS]
    for kind, found in by_kind.items():
        columns.append(Column(kind, f"points of mIoU, {kind}", 1, "mean"))
        columns.append(Column(f"{kind} instruments", "of instruments", 1, "mean"))
        ours = reached(found[OURS])
        for row in rows:
            theirs = reached(found[str(row["system"])])
            row[kind] = [100 * (a - b) for (a, _), (b, _) in zip(ours, theirs, strict=True)]
            tools = [(a, b) for (_, a), (_, b) in zip(ours, theirs, strict=True)]
            row[f"{kind} instruments"] = [100 * (a - b) for a, b in tools if a is not None and b is not None]
    return Table("systems-margins", f"Points of mIoU that {OURS} lies above each system", f"{words(options)} Seed by seed.", columns, rows)


def reached(runs: list[dict[str, Any]]) -> list[tuple[float, float | None]]:
    """mIoU, and that of instruments alone, of each seed of a system with its own best decoder."""
    decoder = best_decoder(runs)
    return [(r["miou"][decoder], of_instruments(r["masks"][decoder]["iou"])) for r in runs]


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]
