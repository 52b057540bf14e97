"""Freed memory goes back to the system when the worker rests, and not while it works."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from degense.app.shell import spare_memory
from degense.app.shell.spare_memory import Giver, SpareMemory, giver
from degense.app.shell.worker import Worker
from tests.house.source import ROOT


@pytest.fixture
def worker(qapp):
    worker = Worker()
    worker.add_channel("view", 20)
    yield worker
    worker.close()


def nothing(value: object) -> None:
    """What listens to nothing."""


class Told:
    """A giver that does a thing at rest."""

    def __init__(self, rested):
        self.rested, self.worked = rested, lambda: None


def test_memory_is_given_back_once_after_work(qtbot, worker, monkeypatch):
    monkeypatch.setattr(spare_memory, "REST_MS", 40)
    monkeypatch.setattr(spare_memory, "much_code", lambda: False)
    given: list[str] = []
    spare = SpareMemory(worker, Told(lambda: given.append(threading.current_thread().name)))
    worker.submit("view", lambda: None, nothing, nothing)
    qtbot.waitUntil(lambda: given == ["worker"])
    qtbot.waitUntil(worker.idle)
    qtbot.wait(150)
    assert given == ["worker"]  # its own answer does not count as work
    gate = threading.Event()
    spare._worked("view")
    worker.submit("view", gate.wait, nothing, nothing)
    qtbot.wait(120)
    assert given == ["worker"]
    gate.set()
    qtbot.waitUntil(lambda: len(given) == 2)


@pytest.mark.parametrize("much", [False, True])
def test_where_code_takes_much_it_is_given_back_once_before_the_next_curves(qtbot, worker, monkeypatch, much):
    worker.add_channel("curves", 50)
    done: list[str] = []
    monkeypatch.setattr(spare_memory, "much_code", lambda: much)
    spare = SpareMemory(worker, Told(lambda: done.append("memory")))
    gate = threading.Event()
    worker.submit("curves", lambda: _curves(gate, done), nothing, nothing)
    worker.submit("view", lambda: done.append("view"), nothing, nothing)
    qtbot.waitUntil(lambda: "view" in done and not worker.busy("view"))
    gate.set()
    qtbot.waitUntil(worker.idle)
    spare._rest.stop()
    assert done == (["view", "memory", "curves"] if much else ["view", "curves"])


def _curves(gate: threading.Event, done: list[str]) -> Iterator[None]:
    """Curves that are not finished before the gate opens, in steps between which other channels have their turn."""
    while not gate.wait(0.01):
        yield
    yield
    done.append("curves")


@pytest.mark.skipif(giver() is None, reason="the C library gives memory back by itself")
@pytest.mark.parametrize("at_work", [False, True])
def test_what_was_freed_leaves_the_program(qapp, monkeypatch, at_work):
    assert sys.platform == "linux"
    monkeypatch.setattr(spare_memory, "GATHERED", -1)  # the program of the tests has free memory for what follows, and does not grow

    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

    to_system = giver()
    assert to_system is not None
    pieces = [b"x" * 60_000 for _ in range(1000)]  # below the size of which the C library maps each by itself
    last = bytes(60_000)  # what lies behind them keeps the heap from shrinking
    filled = resident()
    pieces.clear()
    give = to_system.worked if at_work else to_system.rested
    give()
    assert filled - resident() > 40_000_000
    assert len(last) == 60_000


@pytest.mark.skipif(giver() is None, reason="the C library gives memory back by itself")
def test_at_work_memory_is_looked_for_after_each_step_and_only_where_much_has_gathered(qtbot, worker, monkeypatch):
    own = {"memory": 300_000_000}
    given: list[tuple[int, str]] = []
    monkeypatch.setattr(spare_memory, "_own_memory", lambda: own["memory"])
    monkeypatch.setattr(spare_memory, "much_code", lambda: False)
    to_system = Giver()
    monkeypatch.setattr(to_system, "_library", Library(given, own))
    spare = SpareMemory(worker, to_system)

    def grow() -> Iterator[None]:
        for _ in range(7):
            own["memory"] += 20_000_000
            yield

    worker.submit("view", grow, nothing, nothing)
    qtbot.waitUntil(worker.idle)
    spare._rest.stop()
    assert given == [(380_000_000, "worker"), (360_000_000, "worker")]  # 60 above what the first step left, 60 above 300


class Library:
    """A C library that finds all but 300 MB free."""

    def __init__(self, given: list[tuple[int, str]], own: dict[str, int]):
        self.given, self.own = given, own

    def malloc_trim(self, pad: int) -> None:
        self.given.append((self.own["memory"], threading.current_thread().name))
        self.own["memory"] = 300_000_000


#: A program of its own: in that of the tests, windows may have given everything back before.
CODE = """
import torch
from degense.app.shell import code_pages
from degense.app.shell.spare_memory import giver

give, numbers = giver().rested, torch.arange(6.0).reshape(2, 3)
first = code_pages._resident()
code_pages.KEPT = 2 * first
give()  # not more than is kept: nothing is looked for
kept = code_pages._resident()
code_pages.KEPT = 0
give()
print(first, kept, code_pages._resident(), (numbers @ numbers.T).tolist())
"""


@pytest.mark.skipif(giver() is None, reason="the C library gives memory back by itself")
def test_code_that_ran_once_leaves_the_program_and_runs_again():
    child = subprocess.run([sys.executable, "-c", CODE], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert child.returncode == 0, child.stderr
    first, kept, left, product = child.stdout.split(maxsplit=3)
    assert int(kept) >= int(first)
    assert int(first) - int(left) > 40_000_000
    assert product.strip() == "[[5.0, 14.0], [14.0, 50.0]]"
