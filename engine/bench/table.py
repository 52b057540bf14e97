"""What a benchmark says: one table, printed as Markdown, kept as JSON, drawn as a plot of run time against error."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Cell = str | float | int | None | Sequence[float]


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
    middle: Literal["median", "mean"] = "median"

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
            low, high = min(cell), max(cell)
            return f"{middle:,.{self.digits}f} ({low:,.{self.digits}f}–{high:,.{self.digits}f})" if len(cell) > 1 else self.text(cell[0])
        if isinstance(cell, int):
            return f"{cell:,}"
        return f"{cell:,.{self.digits}f}" if cell == 0 or abs(cell) >= 0.5 * 10**-self.digits else f"{cell:.1e}"

    def value(self, cell: Cell) -> float | None:
        """The one number that stands for a cell; None for words and for nothing."""
        if cell is None or isinstance(cell, str):
            return None
        if isinstance(cell, Sequence):
            return float(getattr(statistics, self.middle)(cell)) if len(cell) else None
        return float(cell)


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
    command, hardware, date : str
        Filled in by `engine.bench.run`.
    """

    name: str
    title: str
    protocol: str
    columns: list[Column]
    rows: list[dict[str, Cell]] = field(default_factory=list)
    pareto: tuple[str, str] | None = None
    command: str = ""
    hardware: str = ""
    date: str = ""

    def markdown(self) -> str:
        """The table alone."""
        lines = ["| " + " | ".join(c.heading for c in self.columns) + " |", "|" + "---|" * len(self.columns)]
        lines += ["| " + " | ".join(c.text(row.get(c.key)) for c in self.columns) + " |" for row in self.rows]
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Table:
        columns = [Column(**column) for column in values["columns"]]
        pareto = tuple(values["pareto"]) if values["pareto"] else None
        return cls(**(values | {"columns": columns, "pareto": pareto}))
