"""Tables of a sweep: for each depth and teacher, the median and the worst scene of every method, next to the baselines."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from degense.engine.errors import DegenseError
from degense.engine.metrics.averages import mean
from degense.engine.metrics.inspection import pooled_average_precision
from degense.engine.metrics.motion import STATIC
from degense.engine.research.baselines import below_baseline
from degense.engine.research.baselines.ceiling import MASK_CEILING
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.sweep.clips import baseline_files
from degense.engine.research.sweep.plan import Depth, SweepPlan, slug
from degense.engine.semantics.prompts import DECODERS, DEFAULT_DECODER
from degense.engine.store.files import read_json

Scores = Mapping[str, Any]
ByScene = dict[int, list[Scores]]  # of one method or baseline: one a seed
OURS, CLOSED = "degense", "rnse+argmax"


@dataclass(frozen=True)
class Score:
    """A score of a table: how it is read, and whether larger is better.

    `compared`: whether a method is marked where a baseline is better. What "nothing moves" wins by its nature is not.
    """

    key: str
    heading: str
    read: Callable[[Scores], float | None]
    digits: int = 3
    larger: bool = True
    compared: bool = True


def relative(key: str) -> Callable[[Scores], float | None]:
    """A length of motion by the mean true motion, or by what counts as static where the scene hardly moves."""

    def read(scores: Scores) -> float | None:
        moved = scores.get("true_displacement")
        if scores.get(key) is None or moved is None:
            return None
        return float(scores[key] / max(moved, STATIC * (scores.get("displacement_scale") or 0.0), 1e-9))

    return read


def inspected(key: str) -> Callable[[Scores], float | None]:
    """A score of the warp layer, where it was scored."""
    return lambda scores: scores.get("inspection", {}).get(key)


def _of_masks(scores: Scores, key: str) -> float | None:
    decoder = scores.get("decoder", "labels")
    return scores["masks"][decoder][key] if decoder in scores.get("masks", {}) else None


def _closed(scores: Scores) -> float | None:
    return scores["miou_closed"][scores["closed"]] if "miou_closed" in scores else _of_masks(scores, "miou")


PICTURES = (
    Score("psnr", "PSNR, dB", lambda s: s.get("psnr_mask"), 2),
    Score("miou", "mIoU", lambda s: _of_masks(s, "miou")),
    Score("closed", "mIoU closed-set", _closed),
    Score("boundary", "boundary F", lambda s: _of_masks(s, "boundary_f")),
    Score("ece", "error of the confidence shown", lambda s: s.get("confidence", {}).get("error"), larger=False),
    Score("seconds", "training, s", lambda s: s.get("train_seconds"), 0, larger=False),
)
MOTION = (
    Score("error", "displacement error", relative("displacement_error"), larger=False),
    Score("correlation", "correlation", lambda s: s.get("displacement_correlation")),
    Score("recovered", "recovered share", lambda s: s.get("recovered_share")),
    Score("charred", "false motion, charred", relative("spurious_displacement_static"), larger=False, compared=False),
    Score("static", "false motion, static", relative("false_motion"), larger=False, compared=False),
)
INSPECTION = (
    Score("ap", "warp: average precision", inspected("average_precision")),
    Score("wrong", "wrong by > 1 px (chance)", inspected("wrong"), larger=False),
    Score("precision", "precision", inspected("precision")),
    Score("recall", "recall", inspected("recall")),
    Score("unknown", "unknown", inspected("unknown"), larger=False),
    Score("sure", "displacement: well recovered where sure", lambda s: s.get("sure_kept")),
    Score("guesses", "guesses among the well recovered", lambda s: s.get("good_guesses"), larger=False),
)
#: The tables: what a name ends with → title, scores.
KINDS = {"masks": ("Pictures and masks", PICTURES), "motion": ("Motion", MOTION), "inspection": ("Inspection of motion", INSPECTION)}


def tables_of(plan: SweepPlan) -> list[Table]:
    """A table of each of `KINDS` for each depth and teacher that anything was scored with. DegenseError when nothing was."""
    found = []
    for depth in plan.depths:
        for teacher in plan.teachers:
            methods = {method: runs for method in plan.methods if (runs := _runs(plan, depth, teacher, method))}
            if methods:
                baselines = _baselines(plan, depth, teacher) if plan.baselines else {}
                for kind, (title, scores) in KINDS.items():
                    scored = {method: runs for method, runs in methods.items() if _has(runs, scores)}
                    if scored:
                        title, name = f"{title}, {plan.preset}, depth {depth}, teacher {teacher}", f"{depth}-{slug(teacher)}-{kind}"
                        found.append(_table(plan, scored, baselines, scores, title, name))
    if not found:
        raise DegenseError(f"{plan.out} holds no scores of this sweep; see the errors in {plan.out / 'scores'}")
    return found


def _table(
    plan: SweepPlan, methods: dict[str, ByScene], baselines: dict[str, ByScene], scores: Sequence[Score], title: str, name: str
) -> Table:
    rows = {method: _row(runs, scores) for method, runs in methods.items()}
    others = {name: _row(runs, scores) for name, runs in baselines.items()}
    others = {name: row for name, row in others.items() if name != MASK_CEILING and _has(baselines[name], scores)}
    columns = [Column("method", "method"), Column("scenes", "scenes", 0)]
    if scores is PICTURES:
        columns.append(Column("decoder", "decoder"))
    if scores is INSPECTION:
        columns.append(Column("pooled", "warp: average precision, all scenes' pixels together", 3))
    for score in scores:
        columns += [Column(score.key, score.heading, score.digits), Column(f"{score.key} worst", "worst", score.digits)]
    cells: list[dict[str, Cell]] = []
    for method, row in rows.items():
        every = [one.get("inspection", {}) for of_seeds in methods[method].values() for one in of_seeds]
        of_all = {"decoder": _decoder(methods[method]), "pooled": pooled_average_precision(every)}
        cells.append({"method": method, "scenes": len(methods[method]), **of_all, **row})
    for score in scores:
        below = below_baseline(rows, others, score.key, score.larger) if score.compared else {}
        for cell in cells:
            if cell["method"] in below:
                cell[score.key] = f"{cell[score.key]:.{score.digits}f} †"
    if scores is PICTURES:
        known = {scene: scores["psnr_ceiling"] for runs in methods.values() for scene, of_seeds in runs.items() for scores in of_seeds}
        ceilings = list(known.values())
        cells.append({"method": "ceiling: a perfect picture", "scenes": len(ceilings), **_middle_and_worst("psnr", ceilings, True)})
        if (of_masks := baselines.get(MASK_CEILING)) is not None:
            cells.append({"method": MASK_CEILING, "scenes": len(of_masks), **_row(of_masks, scores)})
    cells += [{"method": f"baseline: {name}", "scenes": len(baselines[name]), **row} for name, row in others.items()]
    width, height = plan.size
    table = Table(f"surgeries-{plan.which}-{plan.preset}-{width}x{height}-{name}", title, _protocol(plan), columns, cells)
    table.command = plan.command()
    return table


def _has(runs: ByScene, scores: Sequence[Score]) -> bool:
    return any(score.read(one) is not None for of_seeds in runs.values() for one in of_seeds for score in scores)


def _row(runs: ByScene, scores: Sequence[Score]) -> dict[str, float | None]:
    """Median and worst of the scenes, each the mean of its seeds."""
    row: dict[str, float | None] = {}
    for score in scores:
        values = [value for of_seeds in runs.values() if (value := mean(score.read(one) for one in of_seeds)) is not None]
        row |= _middle_and_worst(score.key, values, score.larger)
    return row


def _middle_and_worst(key: str, values: Sequence[float], larger: bool) -> dict[str, float | None]:
    if not values:
        return {key: None, f"{key} worst": None}
    return {key: float(statistics.median(values)), f"{key} worst": float(min(values) if larger else max(values))}


def _runs(plan: SweepPlan, depth: Depth, teacher: str, method: str) -> ByScene:
    """What a method reached, with the decoder that its masks are taken by."""
    found: ByScene = {}
    for job in plan.jobs:
        if (job.depth, job.teacher, job.method) == (depth, teacher, method) and plan.scores(job).exists():
            found.setdefault(job.scene, []).append(read_json(plan.scores(job)))
    every = [scores for of_seeds in found.values() for scores in of_seeds]
    if any("miou" not in scores for scores in every):
        return found
    chosen = {"decoder": DEFAULT_DECODER, "closed": CLOSED}
    if method != OURS and every:
        for kind, key in (("decoder", "miou"), ("closed", "miou_closed")):
            chosen[kind] = max(every[0][key], key=lambda name: mean(scores[key][name] for scores in every) or 0.0)
    return {scene: [{**scores, **chosen} for scores in of_seeds] for scene, of_seeds in found.items()}


def _decoder(runs: ByScene) -> str | None:
    return next(iter(runs.values()))[0].get("decoder")


def _baselines(plan: SweepPlan, depth: Depth, teacher: str) -> dict[str, ByScene]:
    found: dict[str, ByScene] = {}
    for scene in plan.scenes:
        for path, (of_depth, of_teacher) in baseline_files(plan, scene).items():
            if path.exists() and (of_depth == depth if of_teacher is None else of_teacher.startswith(teacher)):
                for name, scores in read_json(path).items():
                    found.setdefault(name, {}).setdefault(scene, []).append(scores)
    return found


def _protocol(plan: SweepPlan) -> str:
    width, height = plan.size
    settings = ", ".join(f"{name}={value}" for name, value in plan.settings.items())
    return (
        f"Surgeries {', '.join(map(str, plan.scenes))} of the set {plan.which}, {plan.frames} frames, {width} × {height}. "
        f"Preset {plan.preset}{' with ' * bool(settings)}{settings}, seeds {', '.join(map(str, plan.seeds))}, {plan.slots} trainings at a "
        "time. Each score: the median of the scenes and the worst scene, each the mean of its seeds. Held-out frames, (i − 1) % 8 == 0; "
        f"motion: all frames. mIoU: all classes as prompts, by the window's decoder {DEFAULT_DECODER} for {OURS}, by the best of "
        f"{', '.join(DECODERS)} for the others. Error and false motion: by the mean true motion of the scene, at least {STATIC:.1%} of its "
        "depth. False motion: beyond the true one, of static tissue, charred or not. Warp: the layer as a detector of motion that is more "
        "than a pixel from the true one. Well recovered: within the bound that the window states. † a baseline is better."
    )
