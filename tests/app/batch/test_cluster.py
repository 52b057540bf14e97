"""A batch on two Dask workers on the loopback: one is killed, all are stopped, and the results are those of an undisturbed run."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from degense.app.batch import cluster
from degense.app.batch.cluster import NO_GPU, NO_WORKER, _outcome, _resources, run_on_cluster
from degense.app.batch.folder import BatchFolder
from degense.app.batch.progress import BatchProgress
from degense.app.cli.main import main
from degense.engine.errors import DegenseError
from degense.engine.processes.capacity import thread_environment
from tests.app.batch.conftest import model

try:
    import dask
    import distributed
except ImportError:
    pytestmark = pytest.mark.skip("needs distributed")
QUIET = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")  # sockets of its client


class Cluster:
    """A scheduler and workers, as people start them."""

    def __init__(self, folder: Path, *names: str) -> None:
        self._file, self._folder = folder / "scheduler.json", folder
        self.processes = {"scheduler": self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(self._file))}
        for name in names:
            self.add(name)

    @property
    def address(self) -> str:
        end = time.monotonic() + 60
        while not self._file.is_file():
            assert time.monotonic() < end
            time.sleep(0.1)
        return json.loads(self._file.read_text())["address"]

    def add(self, name: str) -> None:
        words = ("--nthreads", "1", "--no-nanny", "--name", name, "--local-directory", str(self._folder))
        self.processes[name] = self._start("worker", "--scheduler-file", str(self._file), *words)

    def kill(self, name: str) -> None:
        os.kill(self.processes[name].pid, signal.SIGKILL)

    def close(self) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()

    def _start(self, kind: str, *words: str) -> subprocess.Popen:
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words, "--no-dashboard"]
        environment = {**os.environ, **thread_environment(1), "DASK_DISTRIBUTED__WORKER__MEMORY__TERMINATE": "False"}
        return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def workers(tmp_path_factory) -> Iterator[Cluster]:
    found = Cluster(tmp_path_factory.mktemp("dask"), "w0", "w1")
    yield found
    found.close()


@pytest.fixture
def lonely(tmp_path_factory) -> Iterator[Cluster]:
    """With one worker, which is there."""
    found = Cluster(tmp_path_factory.mktemp("dask"), "only")
    with distributed.Client(found.address) as client:
        client.wait_for_workers(1, timeout=60)
    yield found
    found.close()


def kills_the_only_worker(lonely: Cluster, said: list[tuple[str, str]]):
    """Hears of jobs, and kills the worker when the first training has begun."""

    def changed(job) -> None:
        if job.state == "running" and job.stage == "train" and job.words.rpartition("on ")[0] and "only" in lonely.processes:
            lonely.kill("only")
            lonely.processes.pop("only").wait()
        said.append((job.state, job.words))

    return changed


@QUIET
def test_a_worker_is_lost_then_all_is_stopped_and_the_bits_are_the_same(workers, make_job, tmp_path, trained_once):
    folder = BatchFolder(tmp_path / "out")
    jobs = folder.begin([make_job(name) for name in ("a", "b")])
    places: dict[str, list[str]] = {job.name: [] for job in jobs}
    killed: list[str] = []

    def changed(job):
        if job.state != "running":
            return
        said, _, place = job.words.rpartition("on ")
        places[job.name].append(place)
        if job.stage == "train" and said and not killed:  # it has begun
            killed.append(job.name)
            workers.kill(place)

    progress = BatchProgress(jobs, [], changed)
    run_on_cluster(workers.address, folder, jobs, 1, progress, lambda: any(len(set(found)) == 2 for found in places.values()))
    assert len(set(places[killed[0]])) == 2  # it went on elsewhere, where the stop may have come too late
    assert {job.state for job in progress.jobs.values()} <= {"stopped", "done"}
    left = [job for job in jobs if folder.left(job)]
    again = BatchProgress(left, [], lambda job: None)
    run_on_cluster(workers.address, folder, left, 1, again, lambda: False)
    assert {job.state for job in again.jobs.values()} <= {"done"}
    assert {model(folder, job.name) for job in jobs} == {model(trained_once)}


@QUIET
def test_the_only_worker_is_lost(lonely, make_job, tmp_path, trained_once, capsys):
    """It is said; a stop ends the batch at once; it gives up after its patience; and it goes on when another worker comes."""
    folder = BatchFolder(tmp_path / "out")
    jobs = folder.begin([make_job(name) for name in ("a", "b")])
    said: list[tuple[str, str]] = []
    progress = BatchProgress(jobs, [], kills_the_only_worker(lonely, said))
    run_on_cluster(lonely.address, folder, jobs, 1, progress, lambda: ("waiting", NO_WORKER) in said)
    assert {job.state for job in progress.jobs.values()} == {"stopped"}
    again = BatchProgress(jobs, [], lambda job: None)
    with pytest.raises(DegenseError, match=r"For 3 s no worker .* could do what is left \(no worker is connected to the scheduler\)"):
        run_on_cluster(lonely.address, folder, jobs, 1, again, lambda: False, patience=3.0)
    assert [(job.state, job.words) for job in again.jobs.values()] == [("waiting", NO_WORKER), ("waiting", "")]
    assert main(["batch", "--out", str(folder.path), "--cluster", lonely.address, "--patience", "1"]) == 2
    assert "degense: For 1 s no worker" in capsys.readouterr().err
    late = BatchProgress(jobs, [], lambda job: "later" in lonely.processes or job.words != NO_WORKER or lonely.add("later"))
    run_on_cluster(lonely.address, folder, jobs, 1, late, lambda: False, patience=300.0)
    assert {job.state for job in late.jobs.values()} == {"done"}
    assert {model(folder, job.name) for job in jobs} == {model(trained_once)}


@QUIET
def test_the_workers_are_known_while_the_client_asks_without_them(lonely):
    with (
        dask.config.set({"distributed.client.scheduler-info-interval": "1ms"}),
        distributed.Client(lonely.address, set_as_default=False) as client,
    ):
        left = cluster._Left(lonely.address, client, BatchProgress([], [], lambda job: None), patience=1.0)
        assert all(left.workers() for _ in range(500))


@QUIET
def test_a_gpu_that_nobody_offers_is_waited_for_and_no_longer_than_the_patience(lonely, make_job, tmp_path):
    folder = BatchFolder(tmp_path / "out")
    jobs = folder.begin([make_job("a", device="cuda"), make_job("b", clip=tmp_path / "nothing")])
    progress = BatchProgress(jobs, [], lambda job: None)
    with pytest.raises(DegenseError, match=r"could do what is left \(no worker offers the resource GPU\); start one and call again"):
        run_on_cluster(lonely.address, folder, jobs, 1, progress, lambda: False, patience=4.0)
    assert (progress.jobs["a"].state, progress.jobs["a"].words) == ("waiting", NO_GPU)
    assert progress.jobs["b"].state == "failed"  # what a processor can do was done meanwhile
    heard: list[str] = []
    stopped = BatchProgress(jobs[:1], [], lambda job: heard.append(job.words))
    run_on_cluster(lonely.address, folder, jobs[:1], 1, stopped, lambda: NO_GPU in heard)
    assert stopped.jobs["a"].state == "stopped"


def test_an_answer_that_is_lost_with_its_worker_is_not_waited_for():
    class Lost:
        status = "finished"

        def result(self, timeout):
            raise TimeoutError(timeout)

    assert _outcome(Lost()) == ("stopped", "its worker was lost before it had answered; call again to go on.")


@pytest.mark.parametrize("gpus", [1.0, 2.0, 8.0])
def test_so_many_jobs_fit_on_a_gpu_as_slots_say(make_job, gpus):
    """By the sums of a worker of Dask, which takes what each job wants from what it offers, one after the other."""
    job = make_job(device="cuda")
    for slots in range(1, 33):
        share, free, running = _resources(job, True, slots)["GPU"], gpus, 0
        while free >= share:
            free, running = free - share, running + 1
        assert running == slots * gpus


def test_who_takes_a_share_of_a_gpu(make_job):
    for device, offered, takes in (("cuda", True, True), ("cuda", False, True), ("auto", True, True), ("auto", False, False)):
        assert bool(_resources(make_job(device=device), offered, 4)) is takes, (device, offered)
    assert _resources(make_job(device="cpu"), True, 4) == {}


@QUIET
def test_no_scheduler_is_a_sentence(make_job, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 0.2)
    folder = BatchFolder(tmp_path / "out")
    jobs = folder.begin([make_job()])
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        with pytest.raises(DegenseError, match="There is no Dask scheduler at"):
            run_on_cluster(address, folder, jobs, 1, BatchProgress(jobs, [], lambda job: None), lambda: False)


def test_without_the_package_it_says_what_to_install(make_job, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(DegenseError, match=r"pip install 'degense\[cluster\]'"):
        run_on_cluster("tcp://127.0.0.1:9", BatchFolder(tmp_path), [], 1, BatchProgress([], [], lambda job: None), lambda: False)
