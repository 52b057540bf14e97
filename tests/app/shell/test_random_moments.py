"""Painting while the disk fills up, the folder goes away, a second window opens and the program is killed, at random moments.

As a program it does so more often: `python -m tests.app.shell.test_random_moments 50`.
"""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from degense.app.session.state_folder import left_behind
from degense.app.shell.settings import SettingsFile
from degense.engine.annotation.folder import INDEX
from degense.engine.annotation.painting import PixelRegion
from degense.engine.errors import DegenseError
from tests.app.painting import opened_clip

KINDS = ("kill", "folder gone", "disk full", "two windows")
COLUMNS, FRAMES = 480, 10


def paint(folder: Path, settings: Path, name: str) -> Iterator[str]:
    """Strokes of four dabs of a column each, as a window would make and save them; says when each was ended, or that it was refused."""
    session, annotations = opened_clip(folder)
    file = SettingsFile(settings)
    if session.store.unsaved:
        session.recover()
    ticked, saved = time.monotonic(), time.monotonic()
    for number in range(COLUMNS * FRAMES // 4):
        session.go_to(4 * number // COLUMNS)
        try:
            annotations.begin("Brush")
        except DegenseError:
            yield "refused"
            time.sleep(0.05)
        else:
            for column in range(4 * number % COLUMNS, 4 * number % COLUMNS + 4):
                annotations.dab(PixelRegion(0, column, np.ones((40, 1), bool)))
                time.sleep(0.005)
            annotations.end()
            yield f"{number} {time.monotonic()}"
        now = time.monotonic()
        if now - ticked > 1:
            ticked = now
            session.store.write_pending()
            file.change(lambda settings: replace(settings, training={**settings.training, name: settings.training.get(name, 0) + 1}))
            yield "setting"
        if now - saved > 1.3:
            saved = now
            with suppress(DegenseError):
                session.save()


def start(folder: Path, settings: Path, name: str) -> subprocess.Popen[str]:
    """A program that paints; it has begun when this returns."""
    command = [sys.executable, "-m", __name__ if __name__ != "__main__" else "tests.app.shell.test_random_moments", "paint"]
    out = subprocess.Popen([*command, str(folder), str(settings), name], stdout=subprocess.PIPE, text=True)
    assert out.stdout is not None
    out.stdout.readline()
    return out


def disturb(kind: str, child: subprocess.Popen[str], clip: Path, settings: Path, moment: random.Random) -> list[subprocess.Popen[str]]:
    """Do one thing to a program that paints, and let it go on or not; what else was started."""
    labels, away = clip / "annotations", clip / "unplugged"
    if kind == "folder gone":  # in its place one in which nothing can be written
        for _ in range(20):
            with suppress(OSError):
                labels.rename(away)
                labels.symlink_to("/sys/kernel")
                break
            time.sleep(0.05)
    elif kind == "disk full":
        hard = resource.prlimit(child.pid, resource.RLIMIT_FSIZE)[1]
        resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (256, hard))
        time.sleep(moment.uniform(0.2, 1.5))
        resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (hard, hard))
        time.sleep(2.5)
    elif kind == "two windows":
        second = start(clip, settings, "second")
        time.sleep(moment.uniform(0.1, 1.5))
        return [second]
    time.sleep(moment.uniform(0.0, 1.5))
    return []


def one_moment(folder: Path, kind: str, moment: random.Random) -> Counter[str]:
    """Strokes painted, lost (ended 2 s before the end and gone), refused ones painted all the same, and damaged files."""
    clip, settings = folder / "clip", folder / "settings.json"
    clip.mkdir(parents=True)
    child = start(clip, settings, "first")
    time.sleep(moment.uniform(0.3, 3.0))
    others = disturb(kind, child, clip, settings, moment)
    told, ended = [], time.monotonic()
    for process in (*others, child):
        os.kill(process.pid, signal.SIGKILL)
        told.append(process.communicate()[0].splitlines())
    if (clip / "annotations").is_symlink():
        (clip / "annotations").unlink()
        (clip / "unplugged").rename(clip / "annotations")
    found: Counter[str] = Counter()
    session, annotations = opened_clip(clip)
    offered = left_behind() == []  # this session holds it now
    try:
        session.recover()
        strokes = [line.split() for line in told[-1] if line[0].isdigit()]
        for number, moment_of in strokes:
            column, frame = 4 * int(number) % COLUMNS, 4 * int(number) // COLUMNS
            there = (annotations.labels(frame)[:, column : column + 4] == 0).all()
            found["strokes"] += 1
            found["lost"] += float(moment_of) < ended - 2 and not there
        found["refused"] += sum(line == "refused" for line in told[0]) if others else 0
        found["painted beside"] += sum(line[0].isdigit() for line in told[0]) if others else 0
        session.save()
        for record in annotations.work.records.values():
            record.labels()
        json.loads((clip / "annotations" / INDEX).read_text())
    except DegenseError as error:
        print(error)
        found["damaged"] += 1
    session.close()
    counted = SettingsFile(settings)
    found["damaged"] += counted.complaint is not None or not offered
    for name, lines in zip(("second", "first") if others else ("first",), told, strict=True):
        found["settings lost"] += max(0, lines.count("setting") - counted.value.training.get(name, 0))
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_older_than_two_seconds_is_lost(tmp_path, kind):
    found = one_moment(tmp_path, kind, random.Random(kind))
    assert found["strokes"] > 3
    assert (found["lost"], found["damaged"], found["settings lost"], found["painted beside"]) == (0, 0, 0, 0)
    assert (found["refused"] > 0) == (kind == "two windows")


if __name__ == "__main__" and sys.argv[1] == "paint":
    for line in paint(Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4]):
        print(line, flush=True)
elif __name__ == "__main__":
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as scratch:
        os.environ["XDG_STATE_HOME"] = scratch
        for number in range(int(sys.argv[1])):
            found = one_moment(Path(scratch) / str(number), KINDS[number % len(KINDS)], random.Random(number))
            total.update(found)
            print(number, KINDS[number % len(KINDS)], dict(found), flush=True)
    print(dict(total))
