"""Tables on disk, and the page that is made of a folder of them."""

from __future__ import annotations

import json
import os
import re
from itertools import groupby
from pathlib import Path
from urllib.parse import quote

from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.research.bench.curves import draw_curves
from degense.engine.research.bench.plot import draw_pareto
from degense.engine.research.bench.run import BENCHES
from degense.engine.research.bench.table import Table

MOST_BYTES, MOST_FILES = 8 << 20, 500

INTRODUCTION = """# Benchmarks

Every figure here was measured by the command below its table, on the machine and day named there; the command measures it again on yours.
This page is made of what the commands wrote: `degense bench NAME --out FOLDER`, then `degense bench report FOLDER --out FILE`.

- A cell with several measurements shows the middle and, in brackets, the least and the greatest: repeated timings have the median in the
  middle, scores over seeds the mean.
- Compare times within one table only: they were measured in one run on one machine, which may have had other work.
- Scores of reconstructions are on held-out frames, (i − 1) % 8 == 0, which are never trained on, and count valid pixels only.
- In the plots, run time grows to the right and error upwards. The line joins what nothing else beats in both."""


def save_table(table: Table, folder: Path) -> list[Path]:
    """Write `<name>-<device>.json`, and the plot beside it where the table asks for one; the paths written."""
    path = folder / f"{table.name}-{table.device}.json"
    write_text(path, json.dumps(table.to_json(), indent=1, allow_nan=False, ensure_ascii=False) + "\n")
    plot = path.with_suffix(".png")
    return [path, plot] if draw_pareto(table, plot) or draw_curves(table, plot) else [path]


def read_table(path: Path) -> Table:
    """A table that `save_table` wrote. DegenseError in a sentence for anything else."""
    try:
        if (size := path.stat().st_size) > MOST_BYTES:
            raise DegenseError(f"{path} has {size:,} bytes, more than a benchmark writes; take it out of the folder.")
        return Table.from_json(json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse))
    except (ValueError, RecursionError) as error:  # JSON and its encoding are ValueErrors too
        reason = str(error) if type(error) is ValueError else "it is not JSON"
        raise DegenseError(
            f"{path} cannot be read as a benchmark's table ({reason}); take it out of the folder, or measure again."
        ) from error
    except OSError as error:
        raise DegenseError(f"{path} cannot be read: {error.strerror}.") from error


def write_report(folder: Path, out: Path) -> int:
    """Make the Markdown page of all tables in a folder; how many there are. DegenseError when there are none, or one cannot be read."""
    if not folder.is_dir():
        raise DegenseError(f"{folder} is not a folder; name the one that degense bench --out has written.")
    paths = sorted(folder.glob("*.json"))
    if not paths or len(paths) > MOST_FILES:
        raise DegenseError(
            f"{folder} holds {len(paths)} tables (.json); a page takes 1 to {MOST_FILES}. Make some with degense bench --out."
        )
    tables = sorted(((read_table(path), path) for path in paths), key=lambda entry: _place(entry[0]))
    parts = [INTRODUCTION]
    for bench, of_bench in groupby(tables, key=lambda entry: entry[0].bench):
        parts.append(f"## {_prose(bench).capitalize() or 'Others'}")
        if bench in BENCHES:
            parts.append(BENCHES[bench][1][0].upper() + BENCHES[bench][1][1:] + ".")
        for device, of_device in groupby(of_bench, key=lambda entry: entry[0].device):
            parts.append(f"### {_prose(bench).capitalize()} on the {'GPU' if device == 'cuda' else 'CPU'}")
            for table, path in of_device:
                parts += _section(table, path, out)
    write_text(out, "\n\n".join(parts) + "\n")
    return len(tables)


def plain_section(table: Table) -> str:
    """One table with all that belongs to it, as the terminal shows it."""
    parts = [f"## {table.title}", table.protocol, table.markdown(), table.notes, f"`{table.command}`; {table.hardware}; {table.date}"]
    return "\n\n".join(part for part in parts if part)


def _section(table: Table, path: Path, out: Path) -> list[str]:
    parts = [f"**{_prose(table.title)}.** {_prose(table.protocol)}", table.markdown()]
    if table.notes:
        parts.append(_prose(table.notes))
    plot = path.with_suffix(".png")
    if (table.pareto is not None or table.curves) and plot.is_file():
        link = quote(Path(os.path.relpath(plot.resolve(), out.resolve().parent)).as_posix())
        kind = "run time against error" if table.pareto is not None else "curves"
        parts.append(f"![{_prose(table.title)}: {kind}]({link})")
    return [*parts, f"`{_prose(table.command).replace('`', '')}`; {_prose(table.hardware)}; {_prose(table.date)}"]


def _place(table: Table) -> tuple[int, str, bool, str, int, str]:
    """Benchmarks in the order of their list, the CPU first, tables as they were measured."""
    order = list(BENCHES)
    known = order.index(table.bench) if table.bench in order else len(order)
    return known, table.bench, table.device != "cpu", table.device, table.number, table.name


def _prose(text: str) -> str:
    """Words from a file as one paragraph that cannot become a heading, a tag, a picture or a link of its own."""
    text = " ".join(text.split()).replace("<", "&lt;")
    return re.sub(r"\]\s*([(\[])", r"]\\\1", text).lstrip("#")


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is not a number")
