"""One row of a stress table: what became of a case."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from degense.engine.errors import DegenseError
from degense.engine.research.bench.table import Cell, Column

COLUMNS = [
    Column("case", "case"),
    Column("outcome", "outcome"),
    Column("bad", "non-finite numbers out", 0),
    Column("error", "error against float64", 6),
    Column("gradient", "gradient error", 6),
    Column("seconds", "seconds", 2),
    Column("memory", "peak memory, MB", 0),
]


@dataclass
class StressFinding:
    """What a case gave.

    Attributes
    ----------
    bad : int
        Numbers that came out and are not finite.
    outcome : str
        "ok", or in capitals what is wrong.
    error, gradient : float or None
        Greatest difference from float64 and largest relative gradient error; None where nothing can follow.
    memory : float or None
        MB; None where it was not measured.
    seconds : float or None
        Of what the case is about; None: of all of it.
    """

    bad: int = 0
    outcome: str = "ok"
    error: float | None = None
    gradient: float | None = None
    memory: float | None = None
    seconds: float | None = None


def row(case: str, work: Callable[[], StressFinding], hidden: str = "") -> dict[str, Cell]:
    """Do one case. A DegenseError is an answer, in its own words without `hidden` (a scratch path); any other exception is a defect."""
    begin = time.perf_counter()
    try:
        finding = work()
    except DegenseError as error:
        finding = StressFinding(outcome=f"refused: {str(error).replace(hidden, '…') if hidden else error}")
    except Exception as error:
        finding = StressFinding(outcome=f"CRASHED: {type(error).__name__}: {error}")
    if finding.outcome == "ok" and finding.bad:
        finding.outcome = "NOT FINITE"
    if finding.seconds is None:
        finding.seconds = time.perf_counter() - begin
    return {"case": case, **vars(finding)}


def verdict(**limits: tuple[float, float]) -> str:
    """ "ok", or the names of the errors that exceed what is allowed: each an (error, allowed); NaN always exceeds."""
    wrong = [name.upper() for name, (error, most) in limits.items() if not error <= most]
    return f"{' AND '.join(wrong)} BEYOND TOLERANCE" if wrong else "ok"


def sound(row: dict[str, Cell]) -> bool:
    """Whether a case passed."""
    return str(row["outcome"]).startswith(("ok", "refused")) and row["bad"] == 0


def non_finite(values: object) -> int:
    """How many numbers in arrays, tensors, and lists and dictionaries of them are not finite. None is no number."""
    if isinstance(values, dict):
        return sum(non_finite(value) for value in values.values())
    if isinstance(values, (list, tuple)):
        return sum(non_finite(value) for value in values)
    if isinstance(values, torch.Tensor):
        return int((~torch.isfinite(values)).sum())
    if isinstance(values, (float, int, np.ndarray, np.generic)):
        return int(np.count_nonzero(~np.isfinite(values)))
    return 0
