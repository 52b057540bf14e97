"""A batch in processes of this machine: a lost process, a broken clip, a stop, and what is shown meanwhile."""

from __future__ import annotations

import os
import re
import signal
import sys

import pytest

from degense.app.batch import local
from degense.app.batch.folder import BatchFolder
from degense.app.batch.local import device_of, run_here, slots_for
from degense.app.batch.progress import BatchProgress
from degense.app.batch.report import rows_of
from degense.engine.processes import capacity
from tests.app.batch.conftest import model


@pytest.fixture(autouse=True)
def one_core(monkeypatch):
    """So that a slot has one thread, wherever this runs."""
    monkeypatch.setattr(capacity, "cores", lambda: 1)


@pytest.fixture
def started(monkeypatch):
    """The processes that slots start."""
    processes = []

    def start(environment, begin=local.start):
        processes.append(begin(environment))
        return processes[-1]

    monkeypatch.setattr(local, "start", start)
    return processes


def test_a_killed_process_and_a_broken_clip_hold_up_nobody(make_job, tmp_path, trained_once, started):
    folder = BatchFolder(tmp_path / "out")
    jobs = folder.begin([make_job("broken", clip=tmp_path / "nothing"), make_job("a")])
    lost: list[str] = []

    def changed(job):
        if job.name == "a" and job.stage == "train" and job.words and not lost:
            lost.append(job.words)
            os.kill(started[0].pid, signal.SIGKILL)

    progress = BatchProgress(jobs, [], changed)
    run_here(folder, jobs, 1, "cpu", progress, lambda: False)
    assert lost
    assert len(started) == 2
    assert {job.name: job.state for job in progress.jobs.values()} == {"a": "done", "broken": "failed"}
    assert "nothing does not exist" in progress.jobs["broken"].words
    assert model(folder, "a") == model(trained_once)


#: A process for jobs in which no file may grow beyond 2,000 bytes while the job `full` is done, as on a disk that is full.
WITHOUT_ROOM = """
import resource
from degense.app.batch import child
do, (soft, hard) = child.do_order, resource.getrlimit(resource.RLIMIT_FSIZE)
def do_order(words, tell, stop):
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000 if words["job"]["name"] == "full" else soft, hard))
    return do(words, tell, stop)
child.do_order = do_order
child.main()
"""


def test_a_full_disk_fails_one_job_and_the_others_go_on(make_job, tmp_path, trained_once, monkeypatch):
    with monkeypatch.context() as while_full:
        while_full.setattr(local, "start", lambda environment: local.JobProcess([sys.executable, "-c", WITHOUT_ROOM], environment))
        folder = BatchFolder(tmp_path / "out")
        jobs = folder.begin([make_job("full"), make_job("a")])
        progress = BatchProgress(jobs, [], lambda job: None)
        run_here(folder, jobs, 1, "cpu", progress, lambda: False)
    assert {job.name: job.state for job in progress.jobs.values()} == {"full": "failed", "a": "done"}
    assert re.search(r"full/\S+ cannot be written: File too large", progress.jobs["full"].words)
    assert [row["state"] for row in rows_of(folder, jobs)] == ["failed", "done"]
    assert model(folder, "a") == model(trained_once)
    run_here(folder, jobs[:1], 1, "cpu", progress, lambda: False)  # with room again
    assert progress.jobs["full"].state == "done"
    assert model(folder, "full") == model(trained_once)


def test_a_stop_saves_what_runs_and_begins_nothing(make_job, tmp_path):
    folder = BatchFolder(tmp_path / "out")
    jobs = folder.begin([make_job("a"), make_job("b")])
    trained: list[str] = []
    progress = BatchProgress(jobs, [], lambda job: trained.append(job.words) if job.stage == "train" and job.words else None)
    run_here(folder, jobs, 1, "cpu", progress, lambda: bool(trained))
    assert [job.state for job in progress.jobs.values()] == ["stopped", "waiting"]  # gone on with in test_work.py


def test_a_job_that_ends_every_process_fails(make_job, tmp_path, monkeypatch):
    monkeypatch.setattr(local, "start", lambda environment: local.JobProcess(["python3", "-c", "import os; os.kill(os.getpid(), 9)"], {}))
    folder = BatchFolder(tmp_path / "out")
    jobs = folder.begin([make_job("a")])
    seen: list[str] = []
    progress = BatchProgress(jobs, [], lambda job: seen.append(job.words))
    run_here(folder, jobs, 1, "cpu", progress, lambda: False)
    assert progress.jobs["a"].state == "failed"
    assert "was ended by the system (signal 9), twice" in progress.jobs["a"].words
    assert any("it goes on in another" in words for words in seen)


def test_slots_fit_the_machine(make_job, monkeypatch):
    monkeypatch.setattr(capacity, "free_ram", lambda: None)
    monkeypatch.setattr(capacity, "cores", lambda: 2)
    jobs = [make_job(str(number)) for number in range(5)]
    assert device_of(jobs) == "cpu"
    assert (slots_for(jobs, "cpu"), slots_for(jobs[:1], "cpu")) == (2, 1)
