"""The quick ones of the faults around the program that the campaign's own tests do not meet, and the drive that stalls."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from degense.app.research.reliability import stalls
from degense.app.research.reliability.guarded import REFUSED
from degense.engine.research.bench.child import call_in_child
from tests.app.reliability import cases

SENTENCES = {
    "disk full: training": "cannot be written: File too large",
    "read-only folder: export": "cannot be written: Permission denied; choose another place.",
    "read-only folder: training": "cannot be made: Permission denied",
    "read-only folder: index": "its index can only be read, with --as-is.",
    "permission lost while a run is open": "permission denied",
    "folder renamed under an open run": "it is gone or read-only now",
}


@pytest.fixture
def scratch() -> Iterator[Path]:
    """Where the benchmark has its own, which somebody else than the superuser can be let into, unlike the folders of tests."""
    with tempfile.TemporaryDirectory(prefix="degense-bench-") as folder:
        yield Path(folder) / "faults" / "00"


@pytest.mark.parametrize("name", SENTENCES)
def test_faults_are_met_with_a_sentence(name, scratch):
    fate = call_in_child(cases.met, name, scratch)
    assert fate.outcome == REFUSED, fate.words
    assert SENTENCES[name] in fate.words


def test_a_stalled_drive_stalls_only_what_asks_it(tmp_path, monkeypatch):
    """Opening, renaming, listing and syncing below the folder, and nothing beside it; other threads go on."""
    stood: list[str] = []
    monkeypatch.setattr(stalls.time, "sleep", lambda seconds: stood.append(threading.current_thread().name))
    monkeypatch.setattr(os, "fsync", os.fsync)
    drive, beside = tmp_path / "drive", tmp_path / "drive-beside"
    for folder in (drive, beside):
        folder.mkdir()
    stalls.stall(drive, 1.0)

    def work(folder) -> int:
        stood.clear()
        with (folder / "a").open("w") as file:
            file.write("x")
            os.fsync(file.fileno())
        os.replace(folder / "a", folder / "b")
        os.listdir(folder)
        return len(stood)

    assert work(drive) >= 4
    assert work(beside) == 0
    stalls.stall(drive, 0)
    assert work(drive) == 0
