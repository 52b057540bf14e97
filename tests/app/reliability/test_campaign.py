"""The short form of the campaign: a few cases of each part, and that each part finds what is wrong where something is."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from degense.app.research.reliability import mutations
from degense.app.research.reliability.guarded import READ, REFUSED, guarded, waits_for_a_core
from degense.app.research.reliability.readers import Reader, readers
from degense.app.research.reliability.soak import Slope
from degense.engine.errors import DegenseError
from degense.engine.research.bench.child import call_in_child
from tests.app.reliability import cases

#: Readers of a sample that is made at once, and which of their damaged inputs are tried here: the first ones of another seed.
QUICK = (
    "clip cholecseg8k",
    "clip surgt",
    "points stir",
    "points vl-surgpt",
    "clip nerfstudio",
    "clip colmap-binary",
    "labels coco",
    "labels label-studio",
    "points npz",
    "annotations",
    "session",
    "plan",
)


@pytest.mark.parametrize("name", QUICK)
def test_damaged_inputs_are_read_or_refused(name, tmp_path):
    reader = next(reader for reader in readers() if reader.name == name)
    tally = mutations.tally(reader, 12, tmp_path / "scratch", seed=1)
    assert tally.outcomes.total() == 12
    assert tally.defects == []


def crash(path: Path) -> None:
    if path.read_bytes() != b"sound":
        raise KeyError("a")


def test_a_reader_that_crashes_is_found(tmp_path):
    def make(folder: Path) -> Path:
        (folder / "a.txt").write_bytes(b"sound")
        return folder / "a.txt"

    tally = mutations.tally(Reader("broken", make, crash), 12, tmp_path / "scratch", seed=0)
    assert tally.outcomes["CRASHED"] >= 6
    assert "KeyError" in tally.defects[0]
    assert tally.row()["defects"] == len(tally.defects)


def spin() -> None:
    while True:
        pass


@pytest.mark.parametrize(
    ("work", "outcome"),
    [
        (lambda: None, READ),
        (lambda: time.sleep(60), "HUNG"),
        (spin, "HUNG"),
        (lambda: bytearray(1 << 40), "MEMORY"),
        (lambda: os.kill(os.getpid(), signal.SIGKILL), "DIED"),
        (lambda: {}["a"], "CRASHED"),
    ],
)
def test_every_end_of_a_process_is_told(work, outcome):
    assert guarded(work, 2.0, 512).outcome == outcome


def test_a_refusal_is_a_sentence():
    def refuse() -> None:
        raise DegenseError("a.json is damaged; copy it again.")

    fate = guarded(refuse, 20.0, 512)
    assert (fate.outcome, fate.words) == (REFUSED, "a.json is damaged; copy it again.")


class SeveralLines(DegenseError):
    """Shown as it is, where a DegenseError is shown as one line."""

    def __str__(self) -> str:
        return str(self.args[0])


@pytest.mark.parametrize("text", ["", " ", "a.json is damaged;\ncopy it again.", "Traceback (most recent call last): a.json"])
def test_a_refusal_that_is_no_line_is_a_defect(text):
    def refuse() -> None:
        raise SeveralLines(text)

    fate = guarded(refuse, 20.0, 512)
    assert (fate.outcome, fate.words, fate.sound) == ("NO SENTENCE", text, False)


@pytest.mark.parametrize("name", ["disk full: session", "disk full: export", "disk full: index", "read-only folder: session", "CUDA"])
def test_faults_are_met_with_a_sentence(name, tmp_path):
    fate = call_in_child(cases.met, name, tmp_path / "scratch")
    assert fate.outcome == REFUSED, fate.words


@pytest.mark.parametrize("name", ["clock that", "memory of the GPU"])
def test_faults_that_are_survived(name, tmp_path):
    fate = call_in_child(cases.met, name, tmp_path / "scratch")
    assert fate.outcome == READ, fate.words


def test_the_slope_of_what_grows_and_of_what_does_not():
    rng = np.random.default_rng(0)
    hours = np.linspace(0, 2, 240)
    flat, grows = rng.normal(100, 3, 240), 100 + 12 * hours + rng.normal(0, 3, 240)
    slope = Slope.of(hours, flat)
    assert abs(slope.growth) < 2 * slope.spread
    slope = Slope.of(hours, grows)
    assert slope.growth - slope.spread > 8
    assert slope.growth == pytest.approx(12, abs=2)


@pytest.mark.parametrize(("code", "waits"), [("while True: pass", True), ("import time; time.sleep(60)", False)])
def test_a_process_that_waits_for_a_core_is_not_hung(code, waits):
    """One that could run and has had less than its time, and neither one that sleeps nor one that has had it."""
    with subprocess.Popen([sys.executable, "-c", f"print(1, flush=True)\n{code}"], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        time.sleep(0.2)
        try:
            assert waits_for_a_core(process.pid, 1000.0) is waits
            assert not waits_for_a_core(process.pid, 0.0)
        finally:
            process.kill()
