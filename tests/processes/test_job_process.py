"""A process that does jobs: what it answers, how it stops, and that it does not outlive who started it."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from degense.engine.processes import job_process
from degense.engine.processes.capacity import NUMERIC, RAM_BYTES, cores, slot_environment, thread_environment, trainings_at_once
from degense.engine.processes.job_process import JobProcess, ProcessGone

WORKER = """
import os, sys, time
from degense.engine.processes.job_process import serve

def work(job, tell, stop):
    print("a library prints this")
    if job.get("die"):
        os.kill(os.getpid(), 9)
    tell({"heard": job, "pid": os.getpid()})
    while job.get("wait") and not stop():
        time.sleep(0.01)
    if job.get("deaf"):
        time.sleep(60)
    return {"outcome": "stopped" if stop() else "done", "threads": os.environ["OMP_NUM_THREADS"]}

serve(work)
"""


@pytest.fixture
def process():
    started = JobProcess([sys.executable, "-c", WORKER], thread_environment(3))
    yield started
    started.close()


def test_one_job_after_the_other(process):
    told: list[dict] = []
    for number in range(2):
        assert process.do({"number": number}, told.append, lambda: False) == {"outcome": "done", "threads": "3"}
    assert [said["heard"] for said in told] == [{"number": 0}, {"number": 1}]
    assert {said["pid"] for said in told} == {process.pid}


def test_it_stops_when_asked_and_goes_on_with_the_next(process):
    told: list[dict] = []
    assert process.do({"wait": True}, told.append, lambda: bool(told))["outcome"] == "stopped"
    assert process.do({}, told.append, lambda: False)["outcome"] == "done"


def test_one_that_dies_says_how(process):
    with pytest.raises(ProcessGone, match=r"signal 9"):
        process.do({"die": True}, lambda said: None, lambda: False)


def test_one_that_does_not_listen_is_ended(process, monkeypatch):
    monkeypatch.setattr(job_process, "SAVE_SECONDS", 0.2)
    monkeypatch.setattr(job_process, "TERMINATE_SECONDS", 0.2)
    told: list[dict] = []
    with pytest.raises(ProcessGone):
        process.do({"deaf": True}, told.append, lambda: bool(told))


def test_it_does_not_outlive_who_started_it():
    starter = (
        "import sys; from degense.engine.processes.job_process import JobProcess;"
        f"JobProcess([sys.executable, '-c', {WORKER!r}], {{'OMP_NUM_THREADS': '1'}}).do("
        "{'wait': True}, lambda said: print(said['pid'], flush=True), lambda: False)"
    )
    parent = subprocess.Popen([sys.executable, "-c", starter], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.communicate()
    end = time.monotonic() + 30
    while _alive(pid):
        assert time.monotonic() < end
        time.sleep(0.05)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"  # nobody has asked how it ended
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_slots_share_cores_and_gpus(monkeypatch):
    monkeypatch.setattr("degense.engine.processes.capacity.cores", lambda: 8)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,7")
    assert slot_environment(1, 3, "cpu") == dict.fromkeys(NUMERIC, "2")
    assert [slot_environment(number, 3, "cuda")["CUDA_VISIBLE_DEVICES"] for number in range(3)] == ["4", "7", "4"]
    assert slot_environment(0, 20, "cpu")["OMP_NUM_THREADS"] == "1"


def test_as_many_as_memory_holds(monkeypatch):
    monkeypatch.setattr("degense.engine.processes.capacity.cores", lambda: 64)
    for free, fits in ((None, 64), (5 * RAM_BYTES, 5), (1, 1)):
        monkeypatch.setattr("degense.engine.processes.capacity.free_ram", lambda free=free: free)
        assert trainings_at_once("cpu") == fits
    assert cores() >= 1
