"""Does what `degense batch` says."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from degense.app.cli.batch.table import JsonLines, PlainLines, TerminalTable
from degense.app.cli.training import StopFlag
from degense.engine.errors import Cancelled, DegenseError
from degense.engine.files import write_text

if TYPE_CHECKING:
    from degense.app.batch.folder import BatchFolder
    from degense.app.batch.plan import BatchJob
    from degense.app.batch.progress import BatchProgress


def batch(options: argparse.Namespace) -> int:
    """Do what is left of a batch; the exit status is 1 where jobs failed."""
    from degense.app.batch.folder import BatchFolder

    folder = BatchFolder(Path(options.out))
    jobs = folder.begin(_asked(options)) if options.paths else _kept(options, folder)
    if options.share is not None:
        index, count = options.share
        jobs = jobs[index::count]
    left = [job for job in jobs if folder.left(job)]
    if options.emit is not None:
        return _emit(options, folder, jobs)
    failed = _run(options, folder, jobs, left)
    return 1 if failed else 0


def _asked(options: argparse.Namespace) -> list[BatchJob]:
    """The jobs of the command line, or of the plan that it names."""
    from degense.app.batch.plan import JobOptions, name_of, numbered, with_own_names
    from degense.app.batch.plan_file import found, read_plan

    said = _said(options)
    plans = [path for path in options.paths if path.lower().endswith(".toml")]
    if plans:
        if len(options.paths) > 1:
            raise DegenseError("A plan names all clips: give one .toml file and nothing else, or clips.")
        if said:
            raise DegenseError(f"With a plan, {', '.join(sorted(said))} stands in it, not on the command line.")
        return read_plan(Path(plans[0]))
    here = Path.cwd()
    chosen = JobOptions(**said)
    clips = [clip for path in options.paths for clip in found(path, here)]
    shown = [numbered(number) if chosen.anonymise else clip for number, clip in enumerate(clips, 1)]
    return with_own_names([chosen.job(clip, name_of(name), here) for clip, name in zip(clips, shown, strict=True)])


def _said(options: argparse.Namespace) -> dict[str, Any]:
    """What was said about the jobs."""
    from degense.app.batch.plan import JobOptions

    said = {item.name: getattr(options, item.name) for item in fields(JobOptions)}
    return {name: tuple(value) if isinstance(value, list) else value for name, value in said.items() if value is not None}


def _kept(options: argparse.Namespace, folder: BatchFolder) -> list[BatchJob]:
    if said := _said(options):
        raise DegenseError(
            f"{', '.join(sorted(said))} belongs to clips; name them, or leave it out to go on with the batch in {options.out}."
        )
    return folder.jobs()


def _emit(options: argparse.Namespace, folder: BatchFolder, jobs: Sequence[BatchJob]) -> int:
    from degense.app.batch.slurm import slurm_script

    kind, file = options.emit
    if kind != "slurm":
        raise DegenseError(f"A batch cannot be emitted for {kind!r}; there is slurm.")
    if options.share is not None or options.cluster is not None:
        raise DegenseError("--emit writes a script for all jobs; leave --share and --cluster out.")
    device = "cpu" if all(job.training.device == "cpu" for job in jobs) else "auto"
    write_text(Path(file), slurm_script(folder.path, len(jobs), options.slots or len(jobs), device))
    print(f"{file}: submit it with sbatch; afterwards degense batch --out {options.out} makes the report")
    return 0


def _run(options: argparse.Namespace, folder: BatchFolder, jobs: Sequence[BatchJob], left: Sequence[BatchJob]) -> int:
    """Do the jobs that are left and report; how many failed. Cancelled when it was stopped."""
    from degense.app.batch.progress import BatchProgress
    from degense.app.batch.report import write_report

    view = JsonLines() if options.json else TerminalTable() if sys.stderr.isatty() else PlainLines()
    names = {job.name for job in left}
    finished = [job for job in jobs if job.name not in names]
    progress = BatchProgress(jobs, finished, view.changed)
    view.begin(progress)
    with StopFlag() as stop:
        try:
            if left:
                _do(options, folder, left, progress, stop)
        finally:
            view.end()
    paths = write_report(folder, jobs) if options.share is None else []
    count = progress.count()
    if options.json:
        print(json.dumps({"event": "end", **dict(count), "report": [str(path) for path in paths]}), flush=True)
    else:
        words = ", ".join(f"{number} {state}" for state, number in count.items() if number)
        print("\n".join([f"{folder.path}: {words}", *map(str, paths)]))
    if stop():
        print("what is done is kept; the same command goes on from there", file=sys.stderr)
        raise Cancelled
    return count["failed"]


def _do(options: argparse.Namespace, folder: BatchFolder, left: Sequence[BatchJob], progress: BatchProgress, stop: StopFlag) -> None:
    if options.cluster is not None:
        from degense.app.batch.cluster import PATIENCE, run_on_cluster

        return run_on_cluster(options.cluster, folder, left, options.slots or 1, progress, stop, options.patience or PATIENCE)
    from degense.app.batch.local import device_of, run_here, slots_for

    device = device_of(left)
    run_here(folder, left, min(options.slots or slots_for(left, device), len(left)), device, progress, stop)
