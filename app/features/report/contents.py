"""What a report says, gathered from what is open, and its page: HTML that browsers show and Qt can print. No Qt.

Everything is in the one file: pictures are data, nothing is loaded from elsewhere.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from degense.engine.colour_maps import CLASS_COLOURS
from degense.engine.layer_titles import with_unit
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.app.features.measure.results import Quantity
    from degense.engine.annotation.statistics import ClassCount

#: Width of a picture on the page, and of a chart; pixels.
PICTURE, CHART = 460, 620
NOTICE = "Made with DeGense, research software; not a medical device."


@dataclass(frozen=True)
class Moment:
    """A frame with a picture and what is noted of it; `draw` gives uint8 [H, W, 3]."""

    title: str
    note: str
    draw: Callable[[], np.ndarray]


@dataclass(frozen=True)
class ReportContents:
    """The parts of a report; what is empty is left out."""

    title: str
    facts: Sequence[tuple[str, str]]  # provenance
    moments: Sequence[Moment] = ()
    quantities: Sequence[Quantity] = ()
    classes: Callable[[], Sequence[tuple[str, ClassCount]]] = list  # name and count of each annotated class
    fps: float = 25.0
    made: str = ""  # when
    events: dict[int, str] = field(default_factory=dict)


def report_page(contents: ReportContents) -> Steps[str]:
    """The page. Yields (fraction, words)."""
    parts = [f"<h1>{escape(contents.title)}</h1>", f"<p>{escape(contents.made)}</p>"]
    if contents.moments:
        parts.append("<h2>Pictures</h2>")
    for done, moment in enumerate(contents.moments):
        yield 0.9 * done / len(contents.moments), moment.title
        parts.append(f"<h3>{escape(moment.title)}</h3>{_paragraph(moment.note)}{_picture(png(moment.draw()), moment.title, PICTURE)}")
    yield 0.9, "charts"
    if contents.events:
        notes = [(str(frame), f"{frame / contents.fps:.2f} s", note) for frame, note in contents.events.items()]
        parts += ["<h2>Events</h2>", _table(("Frame", "Time", "Note"), notes)]
    if contents.quantities:
        parts += [
            "<h2>Measures</h2>",
            _table(("What", "First frame", "Last frame", "Lowest", "Highest"), map(_quantity, contents.quantities)),
        ]
        parts += [_picture(chart(item, contents.fps), f"{item.title} over time", CHART) for item in contents.quantities if _known(item)]
    if counts := contents.classes():
        rows = [(title, str(found.frames), f"{found.pixels:,}", f"{found.share:.1%}") for title, found in counts]
        parts += ["<h2>Annotated classes</h2>", _table(("Class", "Frames", "Pixels", "Share"), rows)]
    parts += ["<h2>Where it comes from</h2>", _table(("", ""), contents.facts), f"<p>{NOTICE}</p>"]
    return f"{_HEAD.replace('TITLE', escape(contents.title))}{''.join(parts)}</body></html>\n"


_HEAD = """<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>TITLE</title><style>
body { font-family: sans-serif; color-scheme: light; max-width: 800px; margin: 2em auto; }
table { border-collapse: collapse; } td, th { text-align: left; vertical-align: top; padding: 3px 14px 3px 0; }
h2 { border-bottom: 1px solid; } img { max-width: 100%; }
</style></head><body>"""


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>" if text else ""


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    top = f"<tr>{''.join(f'<th>{escape(head)}</th>' for head in heads)}</tr>" if any(heads) else ""
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>" for cells in rows)
    return f'<table cellpadding="3">{top}{body}</table>'


def _picture(data: bytes, name: str, width: int) -> str:
    return f'<p><img width="{width}" alt="{escape(name)}" src="data:image/png;base64,{base64.b64encode(data).decode("ascii")}"></p>'


def _known(quantity: Quantity) -> bool:
    return bool(np.isfinite(quantity.values).any())


def _quantity(item: Quantity) -> tuple[str, ...]:
    if not _known(item):
        return (item.title, "not known", "", "", "")
    values = (item.values[0], item.values[-1], np.nanmin(item.values), np.nanmax(item.values))
    return (item.title, *(f"{value:.4g} {item.unit}" if np.isfinite(value) else "" for value in values))


def png(image: np.ndarray) -> bytes:
    """uint8 [H, W, 3] as a PNG file."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(image).save(out, "PNG")
    return out.getvalue()


def chart(item: Quantity, fps: float) -> bytes:
    """A PNG of a quantity over time, dark on white."""
    from matplotlib.figure import Figure

    figure = Figure((CHART / 100, 2.2), dpi=200, layout="constrained")
    axes = figure.add_subplot()
    axes.plot(np.arange(len(item.values)) / fps, item.values, color=np.divide(CLASS_COLOURS[4], 255))
    axes.axvline(item.start / fps, color="grey", linewidth=0.8)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(with_unit(item.title, item.unit), fontsize=8)
    axes.grid(alpha=0.3)
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()
