"""Small line charts as SVG, in the colours of the page that holds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

WIDTH, HEIGHT = 340, 250
LEFT, RIGHT, TOP, BOTTOM = 54, 10, 28, 40
#: Okabe and Ito's colours that can be seen on light and on dark ground; further lines are dashed.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9")
DASHES = ("", "6 3", "2 3")


@dataclass(frozen=True)
class Line:
    """A line of a chart: its name and its points (x, y), both in [0, 1]."""

    name: str
    points: Sequence[tuple[float, float]]


def style(number: int) -> tuple[str, str]:
    """Colour and dashes of the line of that number."""
    return COLOURS[number % len(COLOURS)], DASHES[number // len(COLOURS) % len(DASHES)]


def chart(title: str, x: str, y: str, lines: Sequence[Line], *, diagonal: bool = False, mark: float | None = None) -> str:
    """An SVG of lines over the unit square; `diagonal` draws where x equals y, `mark` a vertical line."""
    inner_width, inner_height = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def at(px: float, py: float) -> str:
        return f"{LEFT + inner_width * min(max(px, 0), 1):.1f},{TOP + inner_height * (1 - min(max(py, 0), 1)):.1f}"

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title, quote=True)}">']
    parts.append(f'<text x="{LEFT}" y="16" class="chart-title">{escape(title)}</text>')
    for tick in (0, 0.25, 0.5, 0.75, 1):
        left, below = at(0, tick).split(","), at(tick, 0).split(",")
        parts.append(f'<path class="grid" d="M{at(0, tick)}L{at(1, tick)}M{at(tick, 0)}L{at(tick, 1)}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{float(left[1]) + 4:.1f}" text-anchor="end">{tick:g}</text>')
        parts.append(f'<text x="{below[0]}" y="{float(below[1]) + 15:.1f}" text-anchor="middle">{tick:g}</text>')
    parts.append(f'<text x="{LEFT + inner_width / 2}" y="{HEIGHT - 6}" text-anchor="middle">{escape(x)}</text>')
    middle = TOP + inner_height / 2
    parts.append(f'<text x="12" y="{middle}" text-anchor="middle" transform="rotate(-90 12 {middle})">{escape(y)}</text>')
    if diagonal:
        parts.append(f'<path class="aid" d="M{at(0, 0)}L{at(1, 1)}"/>')
    if mark is not None:
        parts.append(f'<path class="aid" d="M{at(mark, 0)}L{at(mark, 1)}"/>')
    for number, line in enumerate(lines):
        colour, dashes = style(number)
        points = " ".join(at(px, py) for px, py in line.points)
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
        parts.append(f'<polyline points="{points}" stroke="{colour}"{dashed}><title>{escape(line.name)}</title></polyline>')
    return "".join([*parts, "</svg>"])


def legend(names: Sequence[str]) -> str:
    """The names of lines with a piece of each."""
    pieces = []
    for number, name in enumerate(names):
        colour, dashes = style(number)
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
        piece = f'<svg viewBox="0 0 26 8" class="piece"><path d="M0,4L26,4" stroke="{colour}" stroke-width="3"{dashed}/></svg>'
        pieces.append(f"<span>{piece}{escape(name)}</span>")
    return f'<p class="legend">{"".join(pieces)}</p>'
