"""The report over all jobs of a batch: JSON for programs, CSV for spreadsheets, Markdown for people."""

from __future__ import annotations

import csv
import io
import json
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from degense.app.batch.folder import ANSWERS, BatchFolder, JobRecord
from degense.app.batch.plan import BatchJob
from degense.app.features.runs.run_summaries import summary
from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.store.files import read_json

FORMAT = 1
#: Columns: key, heading, digits after the point.
COLUMNS = (
    ("psnr", "PSNR, dB", 2),
    ("miou", "mIoU", 3),
    ("displacement_error", "motion error", 3),
    ("gaussians", "Gaussians", 0),
    ("train_seconds", "training, s", 1),
    ("seconds", "all, s", 1),
)


def rows_of(folder: BatchFolder, jobs: Sequence[BatchJob]) -> list[dict[str, Any]]:
    """What is known of each job, as JSON values; None for what its run does not say."""
    return [_row(folder, job) for job in jobs]


def write_report(folder: BatchFolder, jobs: Sequence[BatchJob]) -> list[Path]:
    """Write `report.json`, `report.csv` and `report.md`; their paths."""
    rows = rows_of(folder, jobs)
    texts = {
        "json": json.dumps({"format": FORMAT, "jobs": rows}, indent=1, ensure_ascii=False) + "\n",
        "csv": _csv(rows),
        "md": markdown(rows),
    }
    paths = [folder.path / f"report.{suffix}" for suffix in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        write_text(path, text)
    return paths


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """All jobs as a table, with the medians, and below it what was asked and what failed."""
    done = [row for row in rows if row["state"] == "done"]
    head = ["job", "state", *(heading for _, heading, _ in COLUMNS)]
    lines = [f"# {len(done)} of {len(rows)} jobs are done", "", _line(head), "|" + "---|" * len(head)]
    lines += [_line([row["job"], row["state"], *(_number(row[key], digits) for key, _, digits in COLUMNS)]) for row in rows]
    medians = [_median([row[key] for row in done]) for key, *_ in COLUMNS]
    lines.append(_line(["median of what is done", "", *(_number(value, entry[2]) for value, entry in zip(medians, COLUMNS, strict=True))]))
    asked = [(row["job"], answer) for row in done for answer in row["answers"]]
    if asked:
        lines += ["", _line(["job", "question", "moments", "frames", "largest area"]), "|---|---|---|---|---|"]
        lines += [_line([job, a["question"], str(a["moments"]), str(a["frames"]), f"{a['largest']:.1%}"]) for job, a in asked]
    failed = [row for row in rows if row["failure"]]
    if failed:
        lines += ["", *(f"- {_safe(row['job'])}: {_safe(row['failure'])}" for row in failed)]
    lines += [
        "",
        "PSNR, mIoU and motion error are of held-out frames and of exact truth, where the clip has them; mIoU by the decoder rnse.",
    ]
    return "\n".join(lines) + "\n"


def _row(folder: BatchFolder, job: BatchJob) -> dict[str, Any]:
    run, record, left = summary(folder.run(job)), folder.record(job), folder.left(job)
    known = {key: getattr(run, key, None) for key, *_ in COLUMNS} | {"seconds": sum(record.seconds.values()) or None}
    begun = bool(record.done) or run.resumable
    state = "done" if not left else "failed" if record.failure else "begun" if begun else "waiting"
    exports = [str(path.relative_to(folder.path)) for name in job.exports if (path := folder.export(job, name)).exists()]
    return {
        "job": job.name,
        "clip": "" if job.anonymise else str(job.training.clip),
        "state": state,
        **known,
        "answers": _answers(folder, job) if job.prompts and "query" not in left else [],
        "exports": exports,
        "left": left,
        "failure": _failure(job, record) if left else "",
    }


def _failure(job: BatchJob, record: JobRecord) -> str:
    """Why a job failed; where it is anonymised, only where that is written, for it may name files."""
    return f"jobs/{job.name}.json says why." if job.anonymise and record.failure else record.failure


def _answers(folder: BatchFolder, job: BatchJob) -> list[dict[str, Any]]:
    """Of each question the number of moments and of frames, and the largest area."""
    try:
        questions = read_json(folder.run(job) / ANSWERS)["questions"]
        return [
            {"question": q["question"], "moments": len(q["moments"]), "frames": sum(q["kept"]), "largest": max(q["areas"], default=0.0)}
            for q in questions
        ]
    except (DegenseError, KeyError, TypeError):
        return []


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    text = io.StringIO()
    keys = ["job", "clip", "state", *(key for key, *_ in COLUMNS), "failure"]
    writer = csv.DictWriter(text, keys, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else None


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:,.{digits}f}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(map(_safe, cells)) + " |"


def _safe(text: str) -> str:
    """Words that cannot break out of a cell."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")
