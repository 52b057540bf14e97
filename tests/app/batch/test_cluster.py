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
from degense.app.batch.cluster import run_on_cluster
from degense.app.batch.folder import BatchFolder
from degense.app.batch.progress import BatchProgress
from degense.engine.errors import DegenseError
from degense.engine.processes.capacity import thread_environment
from tests.app.batch.conftest import model

try:
    import distributed  # noqa: F401
except ImportError:
    pytestmark = pytest.mark.skip("needs distributed")
QUIET = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")  # sockets of its client


class Cluster:
    """A scheduler and workers, as people start them."""

    def __init__(self, folder: Path) -> None:
        self._file, self._folder = folder / "scheduler.json", folder
        self.processes = {"scheduler": self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(self._file))}
        self.add("w0")
        self.add("w1")

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
    found = Cluster(tmp_path_factory.mktemp("dask"))
    yield found
    found.close()


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
