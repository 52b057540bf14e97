"""Freed memory goes back to the system when the worker rests, and not while it works."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from degense.app.shell import spare_memory
from degense.app.shell.spare_memory import SpareMemory, giver
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


def test_memory_is_given_back_once_after_work(qtbot, worker, monkeypatch):
    monkeypatch.setattr(spare_memory, "REST_MS", 40)
    monkeypatch.setattr(spare_memory, "much_code", lambda: False)
    given: list[str] = []
    spare = SpareMemory(worker, lambda: given.append(threading.current_thread().name))
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
    spare = SpareMemory(worker, lambda: done.append("memory"))
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
def test_what_was_freed_leaves_the_program(qapp):
    assert sys.platform == "linux"

    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

    give = giver()
    assert give is not None
    pieces = [b"x" * 60_000 for _ in range(1000)]  # below the size of which the C library maps each by itself
    last = bytes(60_000)  # what lies behind them keeps the heap from shrinking
    filled = resident()
    pieces.clear()
    give()
    assert filled - resident() > 40_000_000
    assert len(last) == 60_000


#: A program of its own: in that of the tests, windows may have given everything back before.
CODE = """
import torch
from degense.app.shell import code_pages
from degense.app.shell.spare_memory import giver

give, numbers = giver(), torch.arange(6.0).reshape(2, 3)
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
