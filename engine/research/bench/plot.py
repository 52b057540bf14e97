"""A table as a picture: run time against error, with the Pareto front. matplotlib's own objects, no global state, no window."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, NullFormatter
from matplotlib.transforms import Bbox, BboxBase

from degense.engine.files import replacing
from degense.engine.research.bench.table import Cell, Column, Table

# Okabe and Ito's colours, told apart by every kind of colour vision.
FRONT, OTHERS, INK, PALE, GRID = "#0072B2", "#E69F00", "#222222", "#6b6b6b", "#e4e4e4"
WIDE = 30.0  # errors that span more than this factor get a logarithmic axis
LABEL_SPOTS = ((7, 5), (7, -12), (-7, 5), (-7, -12), (0, 11), (0, -17), (16, 14), (-16, 14), (16, -22), (-16, -22))  # points from the mark


@dataclass(frozen=True)
class Point:
    """One row: its name, and (middle, least, greatest) of run time and error."""

    name: str
    time: tuple[float, float, float]
    error: tuple[float, float, float]


def points_of(table: Table) -> list[Point]:
    """The rows that have both a run time above zero and an error, in the order of the table."""
    if table.pareto is None:
        return []
    first, time, error = table.columns[0], *(table.column(key) for key in table.pareto)
    found = []
    for row in table.rows:
        spans = _span(time, row.get(time.key)), _span(error, row.get(error.key))
        if spans[0] is not None and spans[1] is not None and spans[0][1] > 0:
            found.append(Point(first.text(row.get(first.key)), spans[0], spans[1]))
    return found


def pareto_front(points: list[Point]) -> list[Point]:
    """Those that no other beats in both run time and error, fastest first."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (p.time[0], p.error[0])):
        if not front or point.error[0] < front[-1].error[0]:
            front.append(point)
    return front


def draw_pareto(table: Table, path: Path) -> bool:
    """Write the plot of a table as PNG. False, and nothing written, when fewer than two rows have both figures."""
    points = points_of(table)
    if len(points) < 2 or table.pareto is None:
        return False
    time, error = (table.column(key) for key in table.pareto)
    figure = Figure(figsize=(8.2, 5.2), dpi=150, facecolor="white", layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_subplot(facecolor="#fcfcfc")
    _scales(axes, points)
    front = pareto_front(points)
    axes.step([p.time[0] for p in front], [p.error[0] for p in front], where="post", color=FRONT, linewidth=1.8, alpha=0.75, zorder=2)
    for chosen, colour, mark in ((front, FRONT, "o"), ([p for p in points if p not in front], OTHERS, "D")):
        _marks(axes, chosen, colour, mark)
    axes.set_xlabel(f"{time.heading}  (logarithmic; less is better)", color=INK)
    axes.set_ylabel(f"{error.heading}  (less is better)", color=INK)
    axes.set_title(table.title, loc="left", fontsize=11.5, fontweight="bold", color=INK, pad=10, wrap=True)
    axes.grid(True, which="major", color=GRID, linewidth=0.8, zorder=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(PALE)
    axes.tick_params(which="both", colors=PALE, labelsize=9)
    axes.margins(x=0.12, y=0.12)
    figure.supxlabel(f"{table.hardware} · {table.date}", fontsize=7.5, color=PALE, x=0.99, ha="right")
    canvas.draw()
    figure.set_layout_engine("none")  # names are placed on the axes as they now lie
    _names(axes, points, canvas)
    with replacing(path) as temporary:
        canvas.print_png(str(temporary), metadata={"Software": None})
    return True


def _span(column: Column, cell: Cell) -> tuple[float, float, float] | None:
    value = column.value(cell)
    if value is None:
        return None
    return (value, min(cell), max(cell)) if isinstance(cell, (list, tuple)) else (value, value, value)


def _scales(axes: Axes, points: list[Point]) -> None:
    axes.set_xscale("log")
    times = [p.time[0] for p in points]
    few = max(times) / min(times) < 30
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}") if few else NullFormatter())
    errors = [p.error[0] for p in points if p.error[0] > 0]
    if errors and max(errors) / min(errors) > WIDE and min(p.error[0] for p in points) >= 0:
        if len(errors) == len(points):
            axes.set_yscale("log")
        else:  # zero has its place, below the least error there is
            least, most = math.floor(math.log10(min(errors))), math.ceil(math.log10(max(errors)))
            axes.set_yscale("symlog", linthresh=10.0**least, linscale=0.5)
            step = max(1, (most - least) // 8)
            axes.set_yticks([0.0, *(10.0**power for power in range(least, most + 1, step))])
            axes.set_ylim(bottom=-0.4 * 10.0**least)


def _marks(axes: Axes, points: list[Point], colour: str, mark: str) -> None:
    axes.errorbar(
        [p.time[0] for p in points],
        [p.error[0] for p in points],
        xerr=_reach([p.time for p in points]),
        yerr=_reach([p.error for p in points]),
        fmt="none",
        ecolor=colour,
        elinewidth=1.0,
        alpha=0.45,
        zorder=3,
    )
    axes.plot(
        [p.time[0] for p in points],
        [p.error[0] for p in points],
        linestyle="none",
        marker=mark,
        markersize=7.5,
        color=colour,
        markeredgecolor="white",
        markeredgewidth=1.1,
        zorder=4,
    )


def _reach(spans: list[tuple[float, float, float]]) -> list[list[float]]:
    """How far the least and the greatest lie from the middle; a mean of two may lie outside them by rounding."""
    return [[max(0.0, middle - low) for middle, low, _ in spans], [max(0.0, high - middle) for middle, _, high in spans]]


def _names(axes: Axes, points: list[Point], canvas: FigureCanvasAgg) -> None:
    """Each name beside its mark, where it covers least of other names, of marks and of what lies outside the axes."""
    renderer = canvas.get_renderer()
    frame = axes.bbox
    marks = [axes.transData.transform((p.time[0], p.error[0])) for p in points]
    taken: list[Bbox] = []
    for point in points:
        best = None
        for x, y in LABEL_SPOTS:
            label = axes.annotate(
                point.name,
                (point.time[0], point.error[0]),
                xytext=(x, y),
                textcoords="offset points",
                ha="left" if x > 0 else "right" if x < 0 else "center",
                fontsize=8.5,
                color=INK,
                path_effects=[withStroke(linewidth=2.5, foreground="white")],
                zorder=5,
                annotation_clip=False,
            )
            box = label.get_window_extent(renderer)
            inside = _overlap(box, frame)
            covered = box.width * box.height - inside + sum(_overlap(box, other) for other in taken)
            covered += 150.0 * sum(bool(box.contains(*mark)) for mark in marks)
            if best is None or covered < best[0]:
                if best is not None:
                    best[1].remove()
                best = covered, label, box
            else:
                label.remove()
            if covered < 1.0:
                break
        assert best is not None
        taken.append(best[2])


def _overlap(a: BboxBase, b: BboxBase) -> float:
    """Area that two boxes share, pixels²."""
    return max(0.0, min(a.x1, b.x1) - max(a.x0, b.x0)) * max(0.0, min(a.y1, b.y1) - max(a.y0, b.y0))
