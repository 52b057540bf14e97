"""The folder of a batch, which is all that it remembers: what is to be done, what is done, and why something failed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from degense.app.batch.plan import BatchJob, with_own_names
from degense.app.features.export.formats import FORMATS
from degense.app.features.runs.run_summaries import SCORES
from degense.engine import untrusted
from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.store.files import read_json, write_json

FORMAT, LARGEST = 1, 16 << 20
PATIENCE = 60.0  # seconds to wait for another process at the same job: one that was lost may still be ending
ANSWERS = "answers.json"


@dataclass(frozen=True)
class JobRecord:
    """What is known of a job: the stages that are done, each with what was asked; the seconds they took; why it failed, empty if not."""

    done: dict[str, Any]
    seconds: dict[str, float]
    failure: str = ""


class BatchFolder:
    """`batch.json` (the jobs), `jobs/` (a record and a lock each), `runs/NAME/` (run folders), `exports/FORMAT/`, `report.*`."""

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()

    @property
    def plan(self) -> Path:
        return self.path / "batch.json"

    def run(self, job: BatchJob) -> Path:
        return self.path / "runs" / job.name

    def export(self, job: BatchJob, name: str) -> Path:
        """Where an export of that format lies: a file, or a folder."""
        return self.path / "exports" / name / f"{job.name}{FORMATS[name].suffix}"

    def product(self, job: BatchJob, stage: str) -> Path:
        """What a stage leaves when it is done."""
        kind, _, name = stage.partition(" ")
        named = {"train": "model.safetensors", "eval": SCORES, "query": ANSWERS}
        return self.export(job, name) if kind == "export" else self.run(job) / named[kind]

    def begin(self, jobs: Sequence[BatchJob]) -> list[BatchJob]:
        """Keep the jobs, with their run folders. DegenseError when a run here was trained otherwise, or the folder holds something else."""
        if self.path.exists() and not self.plan.is_file() and (not self.path.is_dir() or any(self.path.iterdir())):
            raise DegenseError(f"{self.path} is not empty and holds no batch; choose another folder.")
        placed = [replace(job, training=replace(job.training, out=self.run(job))) for job in jobs]
        for job in placed:
            before, wanted = self.record(job).done.get("train", self._begun(job)), job.stages()["train"]
            if before is not None and before != wanted:
                other = sorted(name for name in {*before, *wanted} if before.get(name) != wanted.get(name))
                raise DegenseError(
                    f"{self.run(job)} was trained with another {', '.join(other)}; name the job otherwise, or take the run away."
                )
        write_json(self.plan, {"format": FORMAT, "jobs": [job.to_json() for job in placed]})
        return placed

    def jobs(self) -> list[BatchJob]:
        """The jobs that were kept. DegenseError when there are none."""
        if not self.plan.is_file():
            raise DegenseError(f"{self.path} holds no batch to go on with; name clips or a plan.")
        data = read_json(self.plan)
        if not isinstance(data, dict) or data.get("format") != FORMAT or not isinstance(data.get("jobs"), list):
            raise DegenseError(f"{self.plan} was not written by this version of degense; give the plan again, in another folder.")
        return with_own_names([BatchJob.from_json(entry) for entry in data["jobs"]])

    def record(self, job: BatchJob) -> JobRecord:
        """What is known of a job; a record that cannot be read counts as none, for all that is done is checked on disk."""
        try:
            data = untrusted.read_json(self._file(job, ".json"), LARGEST)
            seconds = {str(stage): float(spent) for stage, spent in data["seconds"].items()}
            record = JobRecord(dict(data["done"]), seconds, str(data["failure"]))
            if not isinstance(record.done.get("train", {}), dict):
                raise ValueError("a training that was asked for in another way")
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return JobRecord({}, {})
        return record

    def keep(self, job: BatchJob, record: JobRecord) -> None:
        write_text(self._file(job, ".json"), json.dumps({"begun": job.stages()["train"], **vars(record)}, indent=1, ensure_ascii=False))

    def left(self, job: BatchJob) -> list[str]:
        """The stages that are still to be done. A run that is trained anew is scored, asked and exported anew."""
        done = self.record(job).done
        left: list[str] = []
        for stage, asked in job.stages().items():
            if left[:1] == ["train"] or done.get(stage) != asked or not self.product(job, stage).exists():
                left.append(stage)
        return left

    @contextmanager
    def hold(self, job: BatchJob) -> Iterator[None]:
        """Nobody else works on the job meanwhile. DegenseError when somebody does, and goes on doing so, or its folder leads elsewhere."""
        self._file(job, "").parent.mkdir(parents=True, exist_ok=True)
        for folder in (self.run(job), *(self.export(job, name).parent for name in job.exports), self._file(job, "").parent):
            if not folder.resolve().is_relative_to(self.path):
                raise DegenseError(f"{folder} leads out of the folder of the batch; take the link away.")
        lock = FileLock(self._file(job, ".lock"))
        try:
            with lock.acquire(timeout=PATIENCE):
                yield
        except Timeout as error:
            raise DegenseError(f"{job.name} is being done by another process; call again when that has ended.") from error

    def _begun(self, job: BatchJob) -> Any:
        """What a training that is not done was begun with; None where none was."""
        try:
            begun = untrusted.read_json(self._file(job, ".json"), LARGEST)["begun"]
        except (OSError, ValueError, TypeError, KeyError):
            return None
        return begun if isinstance(begun, dict) and (self.run(job) / "run.json").is_file() else None

    def _file(self, job: BatchJob, suffix: str) -> Path:
        return self.path / "jobs" / f"{job.name}{suffix}"
