"""`degense bench`."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from degense.app.cli.terminal import Bar
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.research.bench.run import BenchOptions

#: Needs a display, so it is not one of "all".
OF_THE_WINDOW = {
    "window": (
        "degense.app.research.window_bench",
        "how instant the window is: first frame, scrubbing, prompts, brush, stalls (needs a display)",
    )
}
SEEDS, REPEATS = 3, 15
QUICK_SEEDS, QUICK_REPEATS = 1, 5


def bench(options: argparse.Namespace) -> None:
    from degense.engine.research.bench.run import BENCHES, check_names

    benches = BENCHES | OF_THE_WINDOW
    names: list[str] = options.names
    if names[:1] == ["report"]:
        _report(names[1:], options.out)
    elif not names:
        width = max(map(len, benches))
        print("Benchmarks; run some by name, or all of them with: degense bench all\n")
        print("\n".join(f"  {name:<{width}}  {text}" for name, (_, text) in benches.items()))
    else:
        chosen = list(BENCHES) if names == ["all"] else list(dict.fromkeys(names))
        check_names(chosen, benches)
        _run(chosen, options)


def _run(names: list[str], options: argparse.Namespace) -> None:
    """Run benchmarks one after the other; each table is printed, and written, as soon as it is there."""
    from degense.engine.research.bench.report import plain_section, save_table
    from degense.engine.research.bench.run import BENCHES, run

    if options.out is not None and options.out.exists() and not options.out.is_dir():
        raise DegenseError(f"{options.out} is a file; name a folder for the tables and plots.")
    bar = Bar()
    with tempfile.TemporaryDirectory(prefix="degense-bench-") as scratch:
        chosen = _bench_options(options, Path(scratch))
        try:
            for done, name in enumerate(names):

                def progress(fraction: float, message: str, done: int = done, name: str = name) -> None:
                    bar((done + fraction) / len(names), f"{name}: {message}")

                for table in run(name, chosen, progress, BENCHES | OF_THE_WINDOW):
                    bar.close()
                    print(plain_section(table), end="\n\n", flush=True)
                    if options.out is not None:
                        save_table(table, options.out)
        finally:
            bar.close()


def _bench_options(options: argparse.Namespace, scratch: Path) -> BenchOptions:
    from degense.engine.data.readers import open_clip
    from degense.engine.research.bench.run import BenchOptions
    from degense.engine.training.config import choose_device

    for clip in options.clip:
        open_clip(clip)  # a clip that cannot be read is said before an hour of measuring
    seeds = options.seeds or (QUICK_SEEDS if options.quick else SEEDS)
    repeats = options.repeats or (QUICK_REPEATS if options.quick else REPEATS)
    device = choose_device(options.device).type
    return BenchOptions(device, tuple(range(seeds)), repeats, options.quick, scratch, tuple(options.clip))


def _report(folders: list[str], out: Path | None) -> None:
    from degense.engine.research.bench.report import write_report

    if len(folders) != 1 or out is None:
        raise DegenseError("A report is made of one folder into one file: degense bench report FOLDER --out FILE.")
    count = write_report(Path(folders[0]), out)
    print(f"{out}: {count} tables")
