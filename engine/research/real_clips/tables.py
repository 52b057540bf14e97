"""Tables of real clips: one a clip, with what can be scored on it, every system next to the baselines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from degense.engine.errors import DegenseError
from degense.engine.metrics.averages import mean
from degense.engine.metrics.tracks import WITHIN
from degense.engine.research.baselines import below_baseline
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.real_clips.held_out_maps import columns_of, rows_of
from degense.engine.research.real_clips.plan import ClipsPlan, RealClip
from degense.engine.research.real_clips.work import baseline_files
from degense.engine.semantics.prompts import DEFAULT_DECODER
from degense.engine.store.files import read_json

Scores = Mapping[str, Any]


@dataclass(frozen=True)
class ClipScore:
    """A score of a table: how it is read, and whether larger is better."""

    key: str
    heading: str
    read: Callable[[Scores], float | None]
    digits: int = 3
    larger: bool = True


def _miou(scores: Scores) -> float | None:
    of_decoders = scores.get("miou", {})
    return of_decoders.get(DEFAULT_DECODER, of_decoders.get("labels"))


def of_tracks(key: str) -> Callable[[Scores], float | None]:
    """Reads a score of points."""
    return lambda scores: scores.get("tracks", {}).get(key)


SCORES = (
    ClipScore("seconds", "training, s", lambda s: s.get("train_seconds"), 0, larger=False),
    ClipScore("psnr", "PSNR of valid pixels, dB", lambda s: s.get("psnr_mask"), 2),
    ClipScore("ssim", "SSIM", lambda s: s.get("ssim")),
    ClipScore("miou", "mIoU", _miou),
    ClipScore("delta", "tracks: δ", of_tracks("delta")),
    ClipScore("error", "mean error, px", of_tracks("endpoint_error"), 1, larger=False),
    ClipScore("median", "median error, px", of_tracks("endpoint_error_median"), 1, larger=False),
    ClipScore("followed", "points followed", of_tracks("followed"), 2),
)


def tables_of(plan: ClipsPlan) -> list[Table]:
    """Tables of each clip that anything was trained on: scores, and IoU on maps of further frames. DegenseError when nothing was."""
    found = [table for scene in plan.scenes for table in _tables(plan, scene)]
    if not found:
        raise DegenseError(f"{plan.out} holds no scores of these clips; see the errors in {plan.out / 'scores'}")
    return found


def _tables(plan: ClipsPlan, scene: RealClip) -> list[Table]:
    runs: dict[str, list[Scores]] = {method: [] for method in plan.methods}
    for job in plan.jobs:
        if job.scene == scene and plan.scores(job).exists():
            runs[job.method].append(read_json(plan.scores(job)))
    if not any(runs.values()):
        return []
    baselines: dict[str, list[Scores]] = {}
    for path in baseline_files(plan, scene) if plan.baselines else ():
        if path.exists():
            baselines |= {name: [scores] for name, scores in read_json(path).items()}
    table = _table(plan, scene, runs, {name: several for name, several in baselines.items() if set(several[0]) != {"held_out_maps"}})
    of_maps = {**runs, **{f"baseline: {name}": several for name, several in baselines.items()}}
    of_maps = {name: told for name, several in of_maps.items() if (told := [one for one in several if "held_out_maps" in one])}
    return [table, _maps_table(plan, table, of_maps)] if of_maps else [table]


def _table(plan: ClipsPlan, scene: RealClip, runs: Mapping[str, list[Scores]], baselines: Mapping[str, list[Scores]]) -> Table:
    scores = [score for score in SCORES if any(score.read(one) is not None for several in runs.values() for one in several)]
    columns = [Column("method", "method"), *(Column(score.key, score.heading, score.digits, "mean") for score in scores)]
    cells: list[dict[str, Cell]] = [{"method": method, **_row(several, scores)} for method, several in runs.items()]
    rows, others = ({name: _means(several) for name, several in kind.items()} for kind in (runs, baselines))
    for column, score in zip(columns[1:], scores, strict=True):
        below = below_baseline(rows, others, score.key, score.larger)
        for cell in cells:
            if cell["method"] in below:
                cell[score.key] = f"{column.text(cell[score.key])} †"
    cells += [{"method": f"baseline: {name}", **_row(several, scores)} for name, several in baselines.items()]
    first = next(several[0] for several in runs.values() if several)
    table = Table(f"clips-{scene.slug.rpartition('-')[0]}", f"The clip {scene.name}", _protocol(plan, first), columns, cells)
    table.command = plan.command()
    return table


def _maps_table(plan: ClipsPlan, table: Table, several: Mapping[str, list[Scores]]) -> Table:
    """The IoU of each class on maps of further frames, of those that have any."""
    columns = columns_of([one for told in several.values() for one in told])
    rows = [row for name, told in several.items() for row in rows_of(name, told)]
    words = (
        f"As the table above. IoU on maps of frames that were drawn for scoring alone, of the masks of all classes as prompts, by the "
        f"window's decoder {DEFAULT_DECODER}, over valid pixels of which the map says what they are; 0: a class that a frame lacks was "
        "predicted, –: nor was it."
    )
    found = Table(f"{table.name}-maps", f"{table.title}: maps of further frames", words, columns, rows)
    found.command = plan.command()
    return found


def _row(several: Sequence[Scores], scores: Sequence[ClipScore]) -> dict[str, Cell]:
    """The score of each seed."""
    return {score.key: [value for one in several if (value := score.read(one)) is not None] or None for score in scores}


def _means(several: Sequence[Scores]) -> dict[str, float | None]:
    return {score.key: mean(score.read(one) for one in several) for score in SCORES}


def _protocol(plan: ClipsPlan, of_run: Scores) -> str:
    """What was trained and scored, by the scores of one run."""
    width, height = of_run["clip_size"]
    settings = ", ".join(f"{name}={value}" for name, value in plan.settings.items())
    words = (
        f"{of_run['clip_frames']} frames, {width} × {height}; cameras: {of_run['poses']}; teacher: {of_run['teacher']}. "
        f"Preset {plan.preset}{' with ' * bool(settings)}{settings}, seeds {', '.join(map(str, plan.seeds))}, {plan.slots} trainings at a "
        f"time. Pictures{' and masks' * ('miou' in of_run)}: the {len(of_run['frames'])} held-out frames, (i − 1) % 8 == 0, of which "
        f"{of_run['valid_share']:.0%} of the pixels are valid: inside the field of view, and not masked."
    )
    if "miou" in of_run:
        words += f" mIoU: all classes as prompts, by the window's decoder {DEFAULT_DECODER}; of baselines, of label maps."
    if "tracks" in of_run:
        words += (
            f" Tracks: {of_run['tracks']['points']} points that people marked, followed from their first mark; {of_run['tracks']['pairs']} "
            f"later marks, in pixels of the clip. δ: share of the marks that are nearer than a threshold, mean over "
            f"{', '.join(map(str, WITHIN))} px; errors: of points that are followed, which others are not."
        )
    return words + " † a baseline is better."
