"""The reliability campaign, `degense bench reliability`: kills, damaged inputs, hours of work, long trainings, and what goes wrong around
the program.

A case passes when what was there can be read again, or one sentence says what is wrong. Parts are chosen by name: all where none is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from degense.app.research.reliability import faults, kills, mutations
from degense.app.research.reliability.guarded import READ
from degense.app.research.reliability.kills.programs import ALLOWED
from degense.app.research.reliability.readers import readers
from degense.app.research.reliability.tally import COLUMNS, Tally
from degense.engine.errors import LONGEST, DegenseError
from degense.engine.processes.capacity import trainings_at_once
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table

PARTS = ("kills", "mutations", "soak", "faults", "numerics")
MINUTES, QUICK_MINUTES = 240.0, 0.5


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """A table for each part. DegenseError for a part that there is not."""
    told: dict[str, Any] = dict(options.sweep)
    parts = tuple(told.get("parts") or PARTS)
    if unknown := [part for part in parts if part not in PARTS]:
        raise DegenseError(f"There is no part {unknown[0]!r} of the campaign; choose from {', '.join(PARTS)}.")
    makers = {"kills": _kills, "mutations": _mutations, "soak": _soak, "faults": _faults, "numerics": _numerics}
    for number, part in enumerate(parts):

        def tell(fraction: float, words: str, at: int = number) -> None:
            progress((at + fraction) / len(parts), words)

        table = makers[part](options, told, tell)
        table.command = " ".join(filter(None, ["degense bench reliability", part, *_said(told, part), "--quick" * options.quick]))
        yield table


def _said(told: dict[str, Any], part: str) -> list[str]:
    own = {"kills": ("kills",), "mutations": ("inputs",), "soak": ("minutes",), "numerics": ("scenes", "iterations", "slots")}.get(part, ())
    return [f"--{name} {told[name]}" for name in own if told.get(name)]


def _log(options: BenchOptions, part: str) -> Path | None:
    """Where a part keeps what it has found while it goes on; the folder is made."""
    if options.out is None:
        return None
    options.out.mkdir(parents=True, exist_ok=True)
    return options.out / f"{part}-{datetime.now():%Y%m%d-%H%M%S}.jsonl"


def _kills(options: BenchOptions, told: dict[str, Any], progress: Progress) -> Table:
    count = int(told.get("kills") or (kills.QUICK_COUNT if options.quick else kills.COUNT))
    return _table(
        "reliability-kills",
        "Kills",
        f"{count} ends at random moments: SIGKILL, SIGTERM, and a power cut after which only what was synced is left (bytes by fsync of "
        "the file, names by fsync of the folder; of an index, which SQLite writes in place, also with half of the sectors written since). "
        "A signal to a program that has started others goes to these too every other time. Then what is left is opened, and a training, a "
        "batch or an index gone on with to its end. Read: it ends as an undisturbed one, an export under its final name is read whole, and "
        f"no painting is missing (after a power cut none that is older than {ALLOWED:g} s). Nothing yet: nothing had been begun.",
        kills.tallies(count, options.scratch / "kills", 0, progress),
        [Column("nothing", "nothing yet", 0)],
    )


def _mutations(options: BenchOptions, told: dict[str, Any], progress: Progress) -> Table:
    count = int(told.get("inputs") or (mutations.QUICK_COUNT if options.quick else mutations.COUNT))
    log = _log(options, "mutations")
    return _table(
        "reliability-mutations",
        "Damaged inputs",
        f"{count:,} damaged inputs, as many of each kind: bits, lengths and ends of the file; values, names and nesting where the format "
        "has them; what is packed or has a check sum (.gz, .nrrd, PNG, .npz, .pt) is damaged unpacked and packed again. Half are sound "
        "files damaged once; half are damaged further, from inputs that led the program to steps (from one of its lines to the next) that "
        f"it had not taken before. Each is read in a process of its own, with {mutations.SECONDS:g} s and {mutations.MEBIBYTES:,} MiB more "
        f"than the program has. Refused: in a line of three words or more and at most {LONGEST} letters, none of them an exception of "
        "Python's. Neither: any other refusal or exception, a signal, a hang, want of memory, a program or connection, or a place outside "
        "of the input that was opened, listed or changed.",
        mutations.tallies(readers(), count, options.scratch / "mutations", 0, progress, log),
        [Column("steps", "steps taken", 0)],
    )


def _table(name: str, title: str, protocol: str, tallies: Iterable[Tally], further: Sequence[Column] = ()) -> Table:
    return Table(name, title, protocol, [*COLUMNS[:-1], *further, COLUMNS[-1]], [tally.row() for tally in tallies])


def _faults(options: BenchOptions, told: dict[str, Any], progress: Progress) -> Table:
    rows: list[dict[str, Cell]] = []
    for name, fate in faults.fates(options.scratch / "faults", progress):
        outcome = "goes on" if fate.outcome == READ else fate.outcome
        rows.append({"what": name, "outcome": outcome, "words": fate.words, "seconds": fate.seconds})
    columns = [Column("what", "what"), Column("outcome", "outcome"), Column("seconds", "seconds", 1), Column("words", "what is said")]
    return Table("reliability-faults", "Faults around the program", "Each in a process of its own; refused: one sentence.", columns, rows)


def _soak(options: BenchOptions, told: dict[str, Any], progress: Progress) -> Table:
    from degense.app.research.reliability import soak

    minutes = float(told.get("minutes") or (QUICK_MINUTES if options.quick else MINUTES))
    rows = soak.rows(options.scratch / "soak", minutes, progress, _log(options, "soak"))
    columns = [
        Column("what", "what"),
        Column("first", "first tenth", 2),
        Column("last", "last tenth", 2),
        Column("growth", "growth an hour", 2),
        Column("spread", "± (95 %)", 2),
        Column("flat", "flat"),
    ]
    return Table(
        "reliability-soak",
        "Hours of work in the window",
        f"{minutes:g} minutes, {rows[0]['rounds']} rounds: a run is opened, played, scrubbed, asked, painted on, undone and closed, and "
        "the curves of a training drawn; measured after each round when all that can go has gone. Growth: a straight line through twelve "
        "means. Flat: the interval holds zero, or the growth is below what is called flat.",
        columns,
        rows,
    )


def _numerics(options: BenchOptions, told: dict[str, Any], progress: Progress) -> Table:
    from degense.app.research.reliability import numerics

    names = ("scenes", "iterations", "slots", "seconds")
    chosen = numerics.QUICK if options.quick else {}
    chosen = chosen | {name: told[name] for name in names if told.get(name)}
    chosen.setdefault("slots", trainings_at_once(options.device))
    plan = numerics.NumericsPlan((options.out or options.scratch) / "numerics", options.device, **chosen)
    return Table(
        "reliability-numerics",
        "Numbers over long trainings",
        f"{plan.scenes} surgeries of the family (develop), {numerics.FRAMES} frames of {numerics.WIDTH} × {numerics.HEIGHT}, preset quick "
        f"with {numerics.GAUSSIANS} Gaussians, {plan.slots} at a time: each for {plan.iterations:,} iterations, and twice with the same "
        f"seed for {plan.short:,}. Counted: numbers that are not finite in models, logs, scores and drawn frames (colours and "
        "latents), and how often a training diverged and went back. Drawing is beside float64, forward and backward, with the tolerances "
        "of `degense bench stress`. Tensors apart: ‖a − b‖ / ‖a‖ of the tensor furthest off.",
        numerics.COLUMNS,
        list(numerics.rows(plan, progress)),
    )
