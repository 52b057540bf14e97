"""A batch on the workers of a Dask scheduler, each of which does its jobs in a process beside it. A lost worker's jobs go on elsewhere."""

from __future__ import annotations

import asyncio
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
PATIENCE = 600.0  # seconds that are waited while no worker can do any job that is left
#: What is left of a GPU when as many jobs as it is for have taken their shares, so that rounding never keeps the last one out.
SPARE = 1e-6
#: What a job waits for.
NO_WORKER = "no worker is connected to the scheduler; it waits for one"
NO_GPU = "no worker offers the resource GPU; it waits for one"
LOST = "its worker is lost; it goes on in another"
#: Processes of this worker that wait for their next job.
_idle: list[JobProcess] = []


def run_on_cluster(
    address: str,
    folder: BatchFolder,
    jobs: Sequence[BatchJob],
    each_gpu: int,
    progress: BatchProgress,
    stop: Callable[[], bool],
    patience: float = PATIENCE,
) -> None:
    """Do the jobs on the workers; returns when all have ended, or `stop()` turned true and those that ran have saved what they had.

    Where workers offer the resource GPU, a job that may use one takes a share of it, of which `each_gpu` fit into one. DegenseError
    without the package or a scheduler, and when for `patience` seconds no worker could do any job that is left.
    """
    client = _connect(address)
    try:
        from distributed import Variable

        topic = f"degense-{uuid.uuid4().hex}"
        halt = Variable(topic, client=client)
        halt.set(False)
        left = _Left(address, client, progress, patience)
        client.subscribe_topic(topic, lambda event: left.tell(*event[1]))
        offered = left.gpu_offered()
        for job in jobs:
            share = _resources(job, offered, each_gpu)
            future = client.submit(do_on_worker, order(folder, job), topic, key=f"{topic}-{job.name}", resources=share)
            left.add(job.name, future, share)
        halted = False
        while left.futures:
            if not halted and stop():
                halt.set(True)
                halted = True
            left.wait(halted)
        client.unsubscribe_topic(topic)
        halt.delete()
    finally:
        client.close()


class _Left:
    """The jobs that have not ended, and what they wait for."""

    def __init__(self, address: str, client: Client, progress: BatchProgress, patience: float) -> None:
        self.futures: dict[str, Future] = {}  # by the names of jobs; a future that nobody holds is given up
        self._address, self._client, self._progress, self._patience = address, client, progress, patience
        self._ended: queue.Queue[Future] = queue.Queue()
        self._gpu: dict[str, float] = {}  # what each takes of one
        self._places: dict[str, str] = {}  # the address of the worker that told of each last
        self._said: dict[str, str] = {}  # what those wait for of which it was said
        self._free: set[str] = set()  # those that no worker had when that was looked at
        self._hope = self._looked = time.monotonic()  # when a worker could do one of them, and when that was looked at

    def add(self, name: str, future: Future, share: dict[str, float]) -> None:
        """One more, which takes these resources."""
        self.futures[name], self._gpu[name] = future, share.get("GPU", 0.0)
        future.add_done_callback(self._ended.put)

    def tell(self, name: str, stage: str, fraction: float, words: str, place: str) -> None:
        """The worker at an address does one; called from a thread of the client."""
        self._places[name] = place
        self._said.pop(name, None)
        self._progress.tell(name, stage, fraction, words)

    def workers(self) -> dict[str, Any]:
        """What the scheduler knows of its workers, by their addresses. OSError when it does not answer.

        Not by `Client.scheduler_info`: the client asks by itself every few seconds without the workers, and that answer may replace ours.
        """
        scheduler = self._client.scheduler
        if scheduler is None:
            raise ConnectionError
        return self._client.sync(scheduler.identity, n_workers=-1)["workers"]

    def gpu_offered(self) -> bool:
        """Whether a worker offers the resource GPU. DegenseError when the scheduler is gone."""
        try:
            return any(_gpus(worker) for worker in self.workers().values())
        except OSError as error:
            raise self._gone() from error

    def wait(self, halted: bool) -> None:
        """Wait a moment for one that ends. Each second say what the others wait for or, when they are to stop, end those that do not run.

        DegenseError when the scheduler is gone, or no worker could do any of them for the whole patience.
        """
        try:
            future = self._ended.get(timeout=POLL_SECONDS)
        except queue.Empty:
            if self._client.status not in ("running", "connecting"):
                raise self._gone() from None
        else:
            name = str(future.key).split("-", 2)[2]  # degense-TOPIC-NAME
            if self.futures.pop(name, None) is not None:
                self._progress.ended(name, *_outcome(future))
        if time.monotonic() - self._looked >= ASK_SECONDS:
            if halted:
                self._end_unheld()
            else:
                self._look()
            self._looked = time.monotonic()

    def _gone(self) -> DegenseError:
        return DegenseError(f"The scheduler at {self._address} has gone; call again when it is back, and the batch goes on.")

    def _look(self) -> None:
        places = dict(self._places)  # before the workers: who tells meanwhile is not taken for lost
        try:
            workers = self.workers()
        except OSError:  # whether the scheduler is gone shows in the client's status
            return
        most = max((_gpus(worker) for worker in workers.values()), default=0.0)
        waits = {name: LOST for name in self.futures if name in places and places[name] not in workers}
        helpless = [name for name in self.futures if not workers or self._gpu[name] > most]
        why = NO_GPU if workers else NO_WORKER
        waits |= {name: why for name in helpless if name in waits or name == helpless[0]}
        for name in {*waits, *self._said} & self.futures.keys():
            words = waits.get(name, "")
            if self._said.get(name, "") != words:
                self._progress.again(name, words)
                self._said[name] = words
        now = time.monotonic()
        if len(helpless) < len(self.futures):
            self._hope = now
        elif self.futures and now - self._hope > self._patience:
            raise DegenseError(
                f"For {self._patience:g} s no worker of the scheduler at {self._address} could do what is left ({why.partition(';')[0]}); "
                "start one and call again, and the batch goes on."
            )

    def _end_unheld(self) -> None:
        """Those that no worker has are not begun any more: end them here."""
        try:
            held = {key for keys in self._client.processing().values() for key in keys}
        except OSError:
            return
        free = {name for name, future in self.futures.items() if future.key not in held and not future.done()}
        for name in free & self._free:  # still so after a second: it was not just about to be told that it has ended
            self.futures.pop(name).cancel()
            self._progress.ended(name, "stopped")
        self._free = free


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
        worker.log_event(topic, [words["job"]["name"], stage, fraction, f"{said} on {worker.name}".strip(), worker.address])

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


def _gpus(worker: dict[str, Any]) -> float:
    """How much of the resource GPU a worker offers, of what the scheduler knows of it."""
    return float(worker["resources"].get("GPU", 0.0))


def _resources(job: BatchJob, offered: bool, each_gpu: int) -> dict[str, float]:
    """What a job takes of a worker, where workers offer the resource GPU or none does."""
    device = job.training.device or "auto"
    return {"GPU": (1.0 - SPARE) / each_gpu} if device == "cuda" or (device == "auto" and offered) else {}


def _outcome(future: Future) -> tuple[Any, str]:
    """How a job ended, and why."""
    if future.status == "finished":
        try:
            answer = future.result(timeout=CONNECT_SECONDS)
        except (TimeoutError, asyncio.TimeoutError):  # two classes before Python 3.11
            return "stopped", "its worker was lost before it had answered; call again to go on."
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
