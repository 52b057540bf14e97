"""A batch on the workers of a Dask scheduler, each of which does its jobs in a process beside it. A lost worker's jobs go on elsewhere."""

from __future__ import annotations

import os
import queue
import time
import uuid
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from degense.app.batch.child import order, start
from degense.app.batch.folder import BatchFolder
from degense.app.batch.plan import BatchJob
from degense.app.batch.progress import BatchProgress
from degense.engine.errors import DegenseError
from degense.engine.processes.capacity import NUMERIC, cores, thread_environment
from degense.engine.processes.job_process import JobProcess, ProcessGone

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_SECONDS, POLL_SECONDS, ASK_SECONDS = 10.0, 0.2, 1.0
#: Processes of this worker that wait for their next job.
_idle: list[JobProcess] = []


def run_on_cluster(
    address: str, folder: BatchFolder, jobs: Sequence[BatchJob], each_gpu: int, progress: BatchProgress, stop: Callable[[], bool]
) -> None:
    """Do the jobs on the workers; returns when all have ended, or `stop()` turned true and those that ran have saved what they had.

    Where workers offer the resource GPU, a job that may use one takes 1 / `each_gpu` of it. DegenseError without the package or a
    scheduler.
    """
    client = _connect(address)
    try:
        from distributed import Variable

        topic = f"degense-{uuid.uuid4().hex}"
        halt = Variable(topic, client=client)
        halt.set(False)
        client.subscribe_topic(topic, lambda event: progress.tell(*event[1]))
        ended: queue.Queue[Future] = queue.Queue()
        names: dict[str, str] = {}
        futures = []
        for job in jobs:
            key = f"{topic}-{job.name}"
            future = client.submit(do_on_worker, order(folder, job), topic, key=key, resources=_resources(client, job, each_gpu))
            names[key] = job.name
            futures.append(future)  # a future that nobody holds is given up
            future.add_done_callback(ended.put)
        halted = False
        while names:
            if not halted and stop():
                halt.set(True)
                halted = True
            try:
                future = ended.get(timeout=POLL_SECONDS)
            except queue.Empty:
                if client.status not in ("running", "connecting"):
                    raise DegenseError(f"The scheduler at {address} has gone; call again when it is back, and the batch goes on.") from None
                continue
            progress.ended(names.pop(str(future.key)), *_outcome(future))
        client.unsubscribe_topic(topic)
        halt.delete()
    finally:
        client.close()


def do_on_worker(words: dict[str, Any], topic: str) -> dict[str, Any]:
    """Do a job that `child.order` describes, in a process beside this worker; called by Dask on the worker."""
    from distributed import Variable, get_worker

    worker, halt = get_worker(), Variable(topic)
    asked, halted = float("-inf"), False

    def stop() -> bool:
        nonlocal asked, halted
        if not halted and time.monotonic() - asked > ASK_SECONDS:
            halted, asked = bool(halt.get()), time.monotonic()
        return halted

    def tell(stage: str, fraction: float, said: str) -> None:
        worker.log_event(topic, [words["job"]["name"], stage, fraction, f"{said} on {worker.name}".strip()])

    if stop():
        return {"outcome": "stopped", "words": ""}
    tell("", 0.0, "")
    process = _idle.pop() if _idle else start(_environment(worker.state.nthreads))
    try:
        answer = process.do(words, lambda said: tell(said["stage"], said["fraction"], said["words"]), stop)
    except ProcessGone as error:
        return {"outcome": "stopped" if stop() else "failed", "words": f"{error}; call again to go on."}
    _idle.append(process)
    return answer


def _environment(jobs: int) -> dict[str, str]:
    """For a worker's processes: the threads that its own environment gives it, else its share of the cores."""
    given = os.environ.get(NUMERIC[0], "")
    return thread_environment(int(given) if given.isdigit() and int(given) else max(1, cores() // jobs))


def _connect(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError as error:
        raise DegenseError("--cluster needs the package distributed: pip install 'degense[cluster]'.") from error
    try:
        return Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError, TimeoutError) as error:
        raise DegenseError(
            f"There is no Dask scheduler at {address} ({' '.join(str(error).split())}); start one with: dask scheduler"
        ) from error


def _resources(client: Client, job: BatchJob, each_gpu: int) -> dict[str, float]:
    """What a job takes of a worker."""
    device = job.training.device or "auto"
    workers = client.scheduler_info()["workers"].values()
    offered = any(worker["resources"].get("GPU") for worker in workers)
    return {"GPU": 1.0 / each_gpu} if device == "cuda" or (device == "auto" and offered) else {}


def _outcome(future: Future) -> tuple[Any, str]:
    """How a job ended, and why."""
    if future.status == "finished":
        answer = future.result()
        return answer["outcome"], answer["words"]
    if future.status == "cancelled":
        return "stopped", "the scheduler gave it up; call again to go on."
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return "failed", "Every worker that tried it was lost; look for what ends them, memory first."
    return (
        "failed",
        f"Its worker could not do it ({type(error).__name__}: {' '.join(str(error).split())[:300]}); all need the same degense.",
    )
