"""A report on disk: JSON for programs, Markdown for text, and one HTML page that needs nothing beside it."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from itertools import groupby
from pathlib import Path

import cv2

from degense.engine.files import write_text
from degense.engine.research.report.charts import Line, chart, legend
from degense.engine.research.report.method_scores import MethodScores
from degense.engine.research.report.pictures import ReportPicture, class_colour
from degense.engine.research.report.tables import Baselines, Cell, ReportTable, plain, tables_of

FORMAT = 1
JPEG_QUALITY = 88


def write_report(
    folder: Path,
    title: str,
    facts: Mapping[str, str],
    entries: Sequence[MethodScores],
    classes: Sequence[str],
    pictures: Sequence[ReportPicture],
    baselines: Baselines | None = None,
) -> list[Path]:
    """Write `report.json`, `report.md` and `report.html`; their paths.

    Parameters
    ----------
    title : str
    facts : dict of str to str
        What the reader must know: the clip, the teacher, the budget.
    entries : sequence of Entry
        At least one; all scored on the same frames and classes.
    classes : sequence of str
        Of the clip, in the order of its label values.
    pictures : sequence of Picture
        Shown by frame, in their order.
    baselines : dict of str to dict, optional
        Their scores on the same clip, by name.
    """
    tables = tables_of(entries, baselines)
    values = {"format": FORMAT, "title": title, "facts": dict(facts), "methods": {entry.name: entry.to_json() for entry in entries}}
    values["baselines"] = {name: dict(scores) for name, scores in (baselines or {}).items()}
    paths = {name: folder / f"report.{name}" for name in ("json", "md", "html")}
    write_text(paths["json"], json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False) + "\n")
    write_text(paths["md"], _markdown(title, facts, entries, tables))
    write_text(paths["html"], _html(title, facts, entries, tables, classes, pictures))
    return list(paths.values())


def _markdown(title: str, facts: Mapping[str, str], entries: Sequence[MethodScores], tables: Sequence[ReportTable]) -> str:
    parts = [f"# {plain(title)}", "\n".join(f"- {plain(name)}: {plain(words)}" for name, words in facts.items())]
    for table in tables:
        parts += [f"## {plain(table.title)}", table.markdown(), plain(table.words)]
    parts.append("## What each method is")
    parts += [f"**{plain(entry.name)}.** {plain(entry.words)}" for entry in entries]
    return "\n\n".join(parts) + "\n"


def _html(
    title: str,
    facts: Mapping[str, str],
    entries: Sequence[MethodScores],
    tables: Sequence[ReportTable],
    classes: Sequence[str],
    pictures: Sequence[ReportPicture],
) -> str:
    style = files("degense.engine.research.report").joinpath("page.css").read_text(encoding="utf-8")
    first, *others = (_table(table) for table in tables)
    known = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(words)}</dd></div>" for name, words in facts.items())
    parts = [
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta name="color-scheme" content="light dark"><title>{escape(title)}</title><style>{style}</style></head><body><main>',
        f"<h1>{escape(title)}</h1><dl>{known}</dl>",
        first,
        _pictures(pictures, classes),
        others[0],
        _charts(entries),
        *others[1:],
        "<section><h2>What each method is</h2>",
        *(f"<details><summary>{escape(entry.name)}</summary><p class='prose'>{escape(entry.words)}</p></details>" for entry in entries),
        "</section><footer>For research; not a medical device.</footer></main></body></html>",
    ]
    return "\n".join(parts) + "\n"


def _table(table: ReportTable) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    body = "".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in table.rows)
    inside = f"<div class='wide'><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div><p>{escape(table.words)}</p>"
    if table.folded:
        return f"<details><summary>{escape(table.title)}</summary>{inside}</details>"
    return f"<section><h2>{escape(table.title)}</h2>{inside}</section>"


def _cell(cell: Cell) -> str:
    words = f"<b>{escape(cell.text)}</b>" if cell.best else escape(cell.text)
    return f"<td>{words}</td>" if cell.share is None else f'<td class="painted" style="--share:{cell.share:.3f}">{words}</td>'


def _pictures(pictures: Sequence[ReportPicture], classes: Sequence[str]) -> str:
    """A row of pictures for each frame, under the colours of the classes."""
    if not pictures:
        return ""
    keys = "".join(f'<span><i style="background:rgb{class_colour(i)}"></i>{escape(name)}</span>' for i, name in enumerate(classes))
    rows = []
    for frame, of_frame in groupby(sorted(pictures, key=lambda picture: picture.frame), key=lambda picture: picture.frame):
        figures = "".join(
            f'<figure><img alt="{escape(p.caption, quote=True)}, frame {frame}" src="{_data(p)}">'
            f"<figcaption>{escape(p.caption)}</figcaption></figure>"
            for p in of_frame
        )
        rows.append(f"<h3>Frame {frame}</h3><div class='row'>{figures}</div>")
    words = "Each method's label map by its own best decoder, first seed, over the picture it draws."
    return f"<section><h2>Pictures</h2><p class='legend'>{keys}</p>{''.join(rows)}<p>{words}</p></section>"


def _data(picture: ReportPicture) -> str:
    """A picture as a data URI."""
    written, data = cv2.imencode(".jpg", picture.image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert written
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def _charts(entries: Sequence[MethodScores]) -> str:
    """IoU by threshold, and reliability, for both kinds of similarity; first seeds."""
    found = []
    for name, kind in (("threshold", "pixelwise"), ("rnse", "region-aware")):
        calibrations = {entry.name: entry.runs[0]["calibration"][name] for entry in entries}
        by_threshold = [Line(method, [(t, miou) for t, miou in c["curve"]]) for method, c in calibrations.items()]
        reliable = [Line(method, [(b["similarity"], b["share"]) for b in c["reliability"]]) for method, c in calibrations.items()]
        default = next(iter(calibrations.values()))["default"]
        found.append(chart(f"mIoU by threshold, {kind}", "threshold", "mIoU", by_threshold, mark=default))
        found.append(chart(f"Reliability, {kind}", "similarity", "share that has the class", reliable, diagonal=True))
    words = (
        "First seeds. Thin lines: the default threshold; and where a similarity would be the share of pixels that have the class. "
        "Below the diagonal similarities promise too much."
    )
    inside = f"{legend([entry.name for entry in entries])}<div class='charts'>{''.join(found)}</div><p>{words}</p>"
    return f"<section><h2>Thresholds</h2>{inside}</section>"
