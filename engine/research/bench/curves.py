"""A table as curves: its columns against one of them."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from degense.engine.files import replacing
from degense.engine.research.bench.plot import FRONT, GRID, INK, OTHERS, PALE
from degense.engine.research.bench.table import Table

COLOURS = (FRONT, OTHERS, "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#666666")  # but for the grey Okabe and Ito's, too


def draw_curves(table: Table, path: Path) -> bool:
    """Write the curves of a table as PNG. False, and nothing written, for a table without any."""
    if len(table.curves) < 2:
        return False
    across, *others = (table.column(key) for key in table.curves)
    figure = Figure(figsize=(6.4, 4.2), dpi=150, facecolor="white", layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_subplot(facecolor="#fcfcfc")
    for column, colour in zip(others, COLOURS, strict=False):
        points = [(across.value(row.get(across.key)), column.value(row.get(column.key))) for row in table.rows]
        known = [(x, y) for x, y in points if x is not None and y is not None]
        axes.plot([x for x, _ in known], [y for _, y in known], color=colour, marker="o", markersize=3, label=column.heading)
    axes.set_xlabel(across.heading, color=INK)
    if table.logarithmic:
        axes.set_xscale("log")
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)
    axes.set_title(table.title, loc="left", fontsize=10, fontweight="bold", color=INK, wrap=True)
    axes.grid(True, color=GRID, linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=PALE, labelsize=9)
    axes.legend(frameon=False, fontsize=8)
    figure.supxlabel(f"{table.hardware} · {table.date}", fontsize=7, color=PALE, x=0.99, ha="right")
    with replacing(path) as temporary:
        canvas.print_png(str(temporary), metadata={"Software": None})
    return True
