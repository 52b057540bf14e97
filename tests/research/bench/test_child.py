"""Work in a process of its own."""

from __future__ import annotations

import multiprocessing
import os
import time

import numpy as np
import pytest

from degense.engine.errors import Cancelled, DegenseError
from degense.engine.progress import silent
from degense.engine.research.bench.child import call_in_child, in_child, peak_memory
from degense.engine.research.bench.workers import run_jobs


def add(a, b, progress):
    progress(0.5, "half")
    return a + b, os.getpid()


def refuse(progress):
    raise DegenseError("No.")


def break_down(progress):
    raise KeyError("defect")


def vanish(progress):
    os._exit(3)


def linger(progress):
    progress(0.0, "waiting")
    time.sleep(60)


def beat(place, progress=silent):
    """Until somebody ends it, and for a minute at most."""
    for _ in range(600):
        with place.open("a") as file:
            file.write(".")
        time.sleep(0.1)


def beats(place):
    before = place.stat().st_size if place.exists() else 0
    time.sleep(1.0)
    return place.exists() and place.stat().st_size > before


def a_child(place):
    in_child(beat, place, progress=silent)


def a_worker(place):
    list(run_jobs(beat, [place], 1, silent, "jobs"))


def a_child_call_in_child(place):
    call_in_child(beat, place)


def hold(megabytes, progress):
    if megabytes:
        np.ones(megabytes << 17)
    return peak_memory()


def test_result_and_progress_come_back():
    told = []
    total, pid = in_child(add, 2, 3, progress=lambda *said: told.append(said))
    assert total == 5
    assert pid != os.getpid()
    assert told == [(0.5, "half")]


@pytest.mark.parametrize(
    ("work", "error", "words"),
    [(refuse, DegenseError, "^No.$"), (break_down, RuntimeError, "KeyError: 'defect'"), (vanish, RuntimeError, "exit status 3")],
)
def test_failures_come_back(work, error, words):
    with pytest.raises(error, match=words):
        in_child(work, progress=silent)


def test_a_cancelled_child_is_gone():
    def stop(fraction, message):
        raise Cancelled

    with pytest.raises(Cancelled):
        in_child(linger, progress=stop)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("start", [a_child, a_worker, a_child_call_in_child])
def test_nothing_outlives_a_killed_benchmark(tmp_path, start):
    place = tmp_path / "beats"
    bench = multiprocessing.get_context("spawn").Process(target=start, args=(place,))
    bench.start()
    while not beats(place):
        assert bench.is_alive()
    bench.kill()
    bench.join()
    end = time.monotonic() + 30
    while beats(place):
        assert time.monotonic() < end


def test_memory_is_the_childs_own():
    here = np.ones(400 << 17)  # 400 MB held by this process
    little, much = (in_child(hold, megabytes, progress=silent) for megabytes in (0, 200))
    assert here.nbytes == 400 << 20
    if little is not None:  # None: this system does not tell
        assert little < 400
        assert much - little == pytest.approx(200, abs=30)
