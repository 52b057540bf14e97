"""What a benchmark says: one table, printed as Markdown, kept as JSON, drawn as a plot of run time against error."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from numbers import Integral, Real
from typing import Any, Literal, get_args

Cell = str | float | int | None | Sequence[float]
Middle = Literal["median", "mean"]

MOST_COLUMNS, MOST_ROWS, MOST_MEASUREMENTS, LONGEST_TEXT = 64, 10_000, 10_000, 10_000
NAME = re.compile(r"[\w.+-]{1,100}")


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    key : str
        Of the rows' dictionaries.
    heading : str
        With the unit.
    digits : int
        After the decimal point.
    middle : {"median", "mean"}
        What stands for a cell of several measurements: times take the median, scores over seeds the mean.
    """

    key: str
    heading: str
    digits: int = 2
    middle: Middle = "median"

    def text(self, cell: Cell) -> str:
        """A cell in words: "35.24 (35.16–35.40)" for several measurements (least and greatest), a dash for None."""
        if cell is None:
            return "–"
        if isinstance(cell, str):
            return cell
        if isinstance(cell, Sequence):
            middle = self.value(cell)
            if middle is None:
                return "–"
            low, high = float(min(cell)), float(max(cell))
            return f"{self._number(middle)} ({self._number(low)}–{self._number(high)})" if len(cell) > 1 else self.text(cell[0])
        return self._number(cell)

    def value(self, cell: Cell) -> float | None:
        """The one number that stands for a cell; None for words and for nothing."""
        if cell is None or isinstance(cell, str):
            return None
        if isinstance(cell, Sequence):
            return float(getattr(statistics, self.middle)(cell)) if len(cell) else None
        return float(cell)

    def _number(self, number: float) -> str:
        if isinstance(number, Integral):
            return f"{int(number):,}"
        return f"{number:,.{self.digits}f}" if number == 0 or abs(number) >= 0.5 * 10**-self.digits else f"{number:.1e}"


@dataclass
class Table:
    """One benchmark's outcome.

    Attributes
    ----------
    name : str
        Short and unique: the file name of its JSON.
    title : str
    protocol : str
        What was measured, on what, how often: enough to do it again.
    columns : list of Column
    rows : list of dict
        Cells by column key: words, a number, None, or several measurements of one thing (seeds, repeats).
    pareto : (str, str) or None
        Keys of the columns that run time and error are read from, for the plot; its points are named by the first column.
    curves : tuple of str
        Keys of the columns that are drawn as curves, against the first of them; empty for none.
    logarithmic : bool
        Whether the axes of the curves are.
    notes : str
        What the table says, in prose.
    bench, device, number, command, hardware, date : str, int
        Filled in by `engine.research.bench.run`; `number` is the table's place in its benchmark.
    """

    name: str
    title: str
    protocol: str
    columns: list[Column]
    rows: list[dict[str, Cell]] = field(default_factory=list)
    pareto: tuple[str, str] | None = None
    curves: tuple[str, ...] = ()
    logarithmic: bool = False
    notes: str = ""
    bench: str = ""
    device: str = ""
    number: int = 0
    command: str = ""
    hardware: str = ""
    date: str = ""

    def markdown(self) -> str:
        """The table alone."""
        lines = ["| " + " | ".join(_safe(c.heading) for c in self.columns) + " |", "|" + "---|" * len(self.columns)]
        lines += ["| " + " | ".join(_safe(c.text(row.get(c.key))) for c in self.columns) + " |" for row in self.rows]
        return "\n".join(lines)

    def column(self, key: str) -> Column:
        """The column of that key."""
        return next(column for column in self.columns if column.key == key)

    def to_json(self) -> dict[str, Any]:
        """Plain values for strict JSON, which knows no infinity: such cells become words."""
        rows = [{c.key: _plain(c, row.get(c.key)) for c in self.columns} for row in self.rows]
        return asdict(self) | {"rows": rows}

    @classmethod
    def from_json(cls, values: Any) -> Table:
        """The table of `to_json`. ValueError, in words, for anything else."""
        known = {f.name: f for f in fields(cls)}
        if not isinstance(values, dict) or not set(values) <= set(known) or not {"name", "title", "protocol", "columns"} <= set(values):
            raise ValueError("it does not hold a benchmark's table")
        columns = [_column(entry) for entry in _list(values["columns"], MOST_COLUMNS, "columns")]
        keys = [column.key for column in columns]
        if not columns or len(set(keys)) < len(keys):
            raise ValueError("its columns have no names of their own")
        rows = [_row(entry, keys) for entry in _list(values.get("rows", []), MOST_ROWS, "rows")]
        pareto = values.get("pareto")
        if pareto is not None and not (isinstance(pareto, list) and len(pareto) == 2 and all(key in keys for key in pareto)):
            raise ValueError("its plot names columns that it does not have")
        curves = values.get("curves", [])
        if not isinstance(curves, list) or not all(key in keys for key in curves):
            raise ValueError("its curves name columns that it does not have")
        words: dict[str, Any] = {name: _text(values[name], name) for name in values if known[name].type == "str"}
        number = values.get("number", 0)
        if not NAME.fullmatch(words["name"]) or not isinstance(number, int):
            raise ValueError("its name is none")
        plot = (pareto[0], pareto[1]) if pareto else None
        logarithmic = values.get("logarithmic", False) is True
        return cls(**words, columns=columns, rows=rows, pareto=plot, curves=tuple(curves), logarithmic=logarithmic, number=number)


def _plain(column: Column, cell: Cell) -> Cell:
    if cell is None or isinstance(cell, str):
        return cell
    numbers: list[float] = [*cell] if isinstance(cell, Sequence) else [cell]
    if not all(math.isfinite(number) for number in numbers):
        return column.text(cell)
    plain = [int(number) if isinstance(number, Integral) else float(number) for number in numbers]
    return plain if isinstance(cell, Sequence) else plain[0]


def _safe(text: str) -> str:
    """Words that cannot break out of a cell."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def _list(value: Any, most: int, what: str) -> list[Any]:
    if not isinstance(value, list) or len(value) > most:
        raise ValueError(f"its {what} are not a list of at most {most:,}")
    return value


def _text(value: Any, what: str) -> str:
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise ValueError(f"its {what} is not text of at most {LONGEST_TEXT:,} characters")
    return value


def _column(value: Any) -> Column:
    if not isinstance(value, dict) or not {"key", "heading"} <= set(value) <= {"key", "heading", "digits", "middle"}:
        raise ValueError("one of its columns is none")
    digits, middle = value.get("digits", 2), value.get("middle", "median")
    if not isinstance(digits, int) or not 0 <= digits <= 12 or middle not in get_args(Middle):
        raise ValueError("one of its columns has a format that does not exist")
    return Column(_text(value["key"], "column"), _text(value["heading"], "heading"), digits, middle)


def _row(value: Any, keys: list[str]) -> dict[str, Cell]:
    if not isinstance(value, dict) or not set(value) <= set(keys):
        raise ValueError("one of its rows has cells outside its columns")
    for cell in value.values():
        if isinstance(cell, list):
            _list(cell, MOST_MEASUREMENTS, "measurements")
        elif isinstance(cell, str):
            _text(cell, "cell")
        if not all(entry is None or isinstance(entry, str) or _is_number(entry) for entry in (cell if isinstance(cell, list) else [cell])):
            raise ValueError("one of its cells holds neither words nor numbers")
        if isinstance(cell, list) and not all(_is_number(entry) for entry in cell):
            raise ValueError("one of its cells mixes measurements with something else")
    return value


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
