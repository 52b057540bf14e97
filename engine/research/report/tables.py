"""The tables of a report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from degense.engine.research.baselines import below_baseline, note, number
from degense.engine.research.report.method_scores import Figure, MethodScores
from degense.engine.semantics.prompts import DECODERS

Baselines = Mapping[str, Mapping[str, Any]]  # scores by name, of `engine.research.baselines.score_baselines`
INTERVAL = "± is half the 95 % confidence interval of the mean over seeds (Student's t)."


@dataclass(frozen=True)
class Cell:
    """Words, and whether nothing in the column is better."""

    text: str
    best: bool = False
    share: float | None = None
    """In [0, 1], where the cell is painted by it."""


@dataclass
class ReportTable:
    """A table as it is shown; the first column names the rows.

    Attributes
    ----------
    title, words : str
    columns : list of str
    rows : list of list of Cell
    folded : bool
        Whether the page shows it only on demand.
    """

    title: str
    words: str
    columns: list[str]
    rows: list[list[Cell]] = field(default_factory=list)
    folded: bool = False

    def markdown(self) -> str:
        """The table alone; the best of each column is bold."""
        lines = ["| " + " | ".join(map(plain, self.columns)) + " |", "|" + "---|" * len(self.columns)]
        shown = ([f"**{plain(cell.text)}**" if cell.best else plain(cell.text) for cell in row] for row in self.rows)
        return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in shown)])


def tables_of(entries: Sequence[MethodScores], baselines: Baselines | None = None) -> list[ReportTable]:
    """Every table of a report, the most important first. What lies below a baseline is marked with †."""
    known = baselines or {}
    several = len(entries) > 1
    per_frame = [_frames(entry, title=f"IoU frame by frame, {entry.name}", folded=several) for entry in entries]
    against = [_baselines(known)] if known else []
    mask_tables = [_decoders(entries), _thresholds(entries), _false_positives(entries)]
    return [_classes(entries, known), _overall(entries, known), *against, *mask_tables, *per_frame]


def _classes(entries: Sequence[MethodScores], baselines: Baselines) -> ReportTable:
    """The paper's form: methods × classes, and their mean."""
    classes = list(entries[0].masks[0]["iou"])
    scored = entries[0].runs[0]
    where = "Some of these frames were trained on" if scored["mask_frames_trained"] else "Held-out frames"
    table = ReportTable(
        "IoU of each class, %",
        f"{where}; of each class the mean over frames, then the mean over classes. A class that a frame lacks and that is claimed "
        f"there scores 0. Each method by its own best decoder, chosen on these frames. {INTERVAL}",
        ["method", "decoder", *classes, "mean"],
    )
    figures = [[_by_decoder(entry, _of_class(c)) for c in classes] + [_by_decoder(entry, lambda m: m["miou"])] for entry in entries]
    best = [_largest([row[k] for row in figures]) for k in range(len(classes) + 1)]
    below = below_baseline({e.name: {"miou": row[-1].mean} for e, row in zip(entries, figures, strict=True)}, baselines, "miou")
    table.words = " ".join(filter(None, [table.words, note(below, "mean IoU")]))
    for entry, row in zip(entries, figures, strict=True):
        cells = [Cell(f.text(1, 100), f.mean is not None and f.mean == top and len(entries) > 1) for f, top in zip(row, best, strict=True)]
        table.rows.append([Cell(entry.name + " †" * (entry.name in below)), Cell(entry.decoder), *cells])
    floor = entries[0].masks[0]["floor_answer"]
    everywhere = entries[0].masks[0]["floor"]
    said = ["–" if everywhere[c] is None else f"{100 * everywhere[c]:.1f}" if c == floor["class"] else "0" for c in classes]
    table.rows.append([Cell(f"floor: all is {floor['class']}"), Cell(""), *map(Cell, said), Cell(_percent(floor["miou"]))])
    for name, scores in baselines.items():
        for decoder, masks in scores.get("masks", {}).items():
            cells = [Cell(_percent(masks["iou"].get(c))) for c in classes]
            table.rows.append([Cell(f"baseline: {name}"), Cell(decoder), *cells, Cell(_percent(masks["miou"]))])
    return table


@dataclass(frozen=True)
class ScoreColumn:
    """A column of `_overall`: how a score is written, which is better (1 the larger, −1 the smaller, 0 neither), and where it is read."""

    heading: str
    digits: int
    factor: float
    better: int
    read: Callable[[dict[str, Any], str], float | None]  # of a run's scores, by the decoder of the method
    baseline: str = ""  # key of the same score of a baseline; empty where there is none to compare with


COLUMNS = (
    ScoreColumn("mIoU, %", 1, 100, 1, lambda run, d: run["masks"][d]["miou"], "miou"),
    ScoreColumn("mIoU, closed set, %", 1, 100, 1, lambda run, d: number(run, "miou_closed"), "miou"),
    ScoreColumn("absent classes free, %", 1, 100, 1, lambda run, d: run["masks"][d]["miou_present"]),
    ScoreColumn("all pairs, %", 1, 100, 1, lambda run, d: run["masks"][d]["miou_pairs"]),
    ScoreColumn("boundary F, %", 1, 100, 1, lambda run, d: run["masks"][d]["boundary_f"], "boundary_f"),
    ScoreColumn("flicker, %", 2, 100, -1, lambda run, d: run["flicker"][d]),
    ScoreColumn("PSNR, dB", 2, 1, 1, lambda run, d: run["psnr_mask"], "psnr_mask"),
    ScoreColumn("motion: error", 3, 1, -1, lambda run, d: run.get("displacement_error"), "displacement_error"),
    ScoreColumn("correlation", 2, 1, 1, lambda run, d: run.get("displacement_correlation"), "displacement_correlation"),
    ScoreColumn("recovered share", 2, 1, 1, lambda run, d: run.get("recovered_share"), "recovered_share"),
    ScoreColumn("false motion", 3, 1, 0, lambda run, d: run.get("false_motion")),
    ScoreColumn("spurious motion", 3, 1, 0, lambda run, d: run.get("spurious_displacement")),
    ScoreColumn("training, s", 0, 1, 0, lambda run, d: run["train_seconds"]),
    ScoreColumn("Gaussians", 0, 1, 0, lambda run, d: run["gaussians"]),
)


def _overall(entries: Sequence[MethodScores], baselines: Baselines) -> ReportTable:
    """What else is known of each method."""
    table = ReportTable(
        "All scores",
        "Masks are those that a prompt for each class shows; “closed set”: label maps in which each pixel takes its likeliest class, by "
        "the better of both kinds of similarity. “All pairs” averages over all pairs of frame and class, as the peers do; there, and "
        "under “absent classes free”, false positives on classes that a frame lacks cost nothing. Flicker: pixels whose label changes "
        "from one frame to the next although neither the recording nor the truth gives a reason. Motion is scored where a clip brings "
        "exact truth, in its own unit; false and spurious motion are nothing to be proud of without correlation and recovered share, "
        "since what never moves has none. "
        f"{INTERVAL}",
        ["method"],
        [[Cell(entry.name)] for entry in entries],
    )
    for column in COLUMNS:
        figures = [entry.figure(lambda run, e=entry, c=column: c.read(run, e.decoder)) for entry in entries]  # type: ignore[misc]
        known = [f.mean for f in figures if f.mean is not None]
        if not known:
            continue
        rows = {entry.name: {column.baseline: f.mean} for entry, f in zip(entries, figures, strict=True)}
        below = below_baseline(rows, baselines, column.baseline, column.better >= 0)
        table.words = " ".join(filter(None, [table.words, note(below, column.heading)]))
        top = max(column.better * value for value in known)
        table.columns.append(column.heading)
        for entry, row, f in zip(entries, table.rows, figures, strict=True):
            best = column.better != 0 and len(entries) > 1 and f.mean is not None and column.better * f.mean == top
            row.append(Cell(f.text(column.digits, column.factor) + " †" * (entry.name in below), best))
    return table


def _baselines(baselines: Baselines) -> ReportTable:
    """What needs no scene."""
    columns = [column for column in COLUMNS if column.baseline and "closed" not in column.heading]
    table = ReportTable(
        "Baselines",
        "Answers that need no scene: what the teacher says, votes over its answers, labels and pixels followed by optical flow, one "
        "colour, the nearest training frame. Masks are closed-set label maps. Scored as the methods are; a dash: it says nothing about "
        "that.",
        ["baseline", *(column.heading for column in columns)],
    )
    for name, scores in baselines.items():
        figures = ((column, Figure.of([number(scores, column.baseline)])) for column in columns)
        table.rows.append([Cell(name), *(Cell(f.text(column.digits, column.factor)) for column, f in figures)])
    return table


def _decoders(entries: Sequence[MethodScores]) -> ReportTable:
    table = ReportTable(
        "mIoU of all decoders on the same latent, %", f"The best decoder of each method is bold. {INTERVAL}", ["method", *DECODERS]
    )
    for entry in entries:
        figures = {d: entry.figure(lambda run, d=d: run["miou"][d]) for d in DECODERS}  # type: ignore[misc]
        table.rows.append([Cell(entry.name), *(Cell(f.text(1, 100), d == entry.decoder) for d, f in figures.items())])
    return table


def _thresholds(entries: Sequence[MethodScores]) -> ReportTable:
    table = ReportTable(
        "Calibration of the threshold",
        "Masks of single prompts, similarity above a threshold, no class competing. The best threshold is chosen on the scored frames "
        "themselves: what it gains is an upper bound. Calibration error: how far similarities are from the share of pixels that truly "
        "have the class. Mean over seeds.",
        ["method", "similarity", "default", "mIoU, %", "best", "mIoU, %", "calibration error"],
    )
    for entry in entries:
        for name, kind in (("threshold", "pixelwise"), ("rnse", "region-aware")):
            keys = ("default", "miou_default", "best", "miou_best", "error")
            found = {key: entry.figure(lambda run, n=name, k=key: run["calibration"][n][k]).mean for key in keys}  # type: ignore[misc]
            values = [_number(found["default"]), _percent(found["miou_default"]), _number(found["best"]), _percent(found["miou_best"])]
            table.rows.append([Cell(entry.name), Cell(kind), *map(Cell, values), Cell(_number(found["error"], 3))])
    return table


def _false_positives(entries: Sequence[MethodScores]) -> ReportTable:
    classes = list(entries[0].masks[0]["false_positives"])
    table = ReportTable(
        "False positives on classes that a frame lacks",
        "In how many of the frames that lack a class it was claimed, and the share of pixels claimed there. All seeds together.",
        ["method", *classes],
    )
    for entry in entries:
        row = [Cell(entry.name)]
        for c in classes:
            found = [masks["false_positives"][c] for masks in entry.masks]
            absent = sum(f["absent"] for f in found)
            share = Figure.of([f["share"] for f in found]).mean
            row.append(
                Cell(f"{sum(f['frames'] for f in found)} of {absent} ({100 * share:.2f} %)" if share is not None else "never absent")
            )
        table.rows.append(row)
    return table


def _frames(entry: MethodScores, title: str, folded: bool) -> ReportTable:
    """IoU of every class in every frame, of the first seed."""
    ious = entry.masks[0]["iou_frames"]
    words = f"First seed, decoder {entry.decoder}, %. A dash: the frame lacks the class, and it was not claimed."
    table = ReportTable(title, words, ["frame", *ious], folded=folded)
    for position, frame in enumerate(entry.runs[0]["mask_frames"]):
        values = [ious[c][position] for c in ious]
        table.rows.append([Cell(str(frame)), *(Cell("–" if v is None else f"{100 * v:.0f}", share=v) for v in values)])
    return table


def _of_class(name: str) -> Callable[[dict[str, Any]], float | None]:
    return lambda masks: masks["iou"][name]


def _by_decoder(entry: MethodScores, read: Callable[[dict[str, Any]], float | None]) -> Figure:
    return entry.figure(lambda run: read(run["masks"][entry.decoder]))


def _largest(figures: list[Figure]) -> float | None:
    return max((f.mean for f in figures if f.mean is not None), default=None)


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f}"


def _number(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def plain(text: str) -> str:
    """Words that Markdown takes for nothing else, on one line."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")
