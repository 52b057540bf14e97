"""A process that does the jobs of a batch which it is told: `python -m degense.app.batch.child`. Programs start it, not people."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from degense.app.batch.folder import BatchFolder
from degense.app.batch.plan import BatchJob
from degense.app.batch.work import do_job
from degense.engine.errors import Cancelled, DegenseError
from degense.engine.processes.capacity import NUMERIC
from degense.engine.processes.job_process import JobProcess, Tell, serve


def start(environment: Mapping[str, str]) -> JobProcess:
    """A process for jobs, with these variables."""
    return JobProcess([sys.executable, "-m", "degense.app.batch.child"], environment)


def order(folder: BatchFolder, job: BatchJob) -> dict[str, Any]:
    """What such a process is told to do."""
    return {"folder": str(folder.path), "job": job.to_json()}


def do_order(words: dict[str, Any], tell: Tell, stop: Callable[[], bool]) -> dict[str, Any]:
    """Do a job that `order` describes; how it ended: {"outcome": "done" | "stopped" | "failed", "words": why}."""
    try:
        job = BatchJob.from_json(words["job"])
        do_job(
            BatchFolder(Path(words["folder"])), job, lambda *said: tell(dict(zip(("stage", "fraction", "words"), said, strict=True))), stop
        )
    except DegenseError as error:
        return {"outcome": "failed", "words": str(error)}
    except Cancelled:
        return {"outcome": "stopped", "words": ""}
    except Exception as error:
        traceback.print_exc()
        return {"outcome": "failed", "words": f"The program met a defect ({type(error).__name__}: {error})."}
    return {"outcome": "done", "words": ""}


def main() -> None:
    import cv2
    import torch

    threads = int(os.environ.get(NUMERIC[0], "1"))
    cv2.setNumThreads(threads)
    torch.set_num_threads(threads)
    serve(do_order)


if __name__ == "__main__":
    main()
