"""A session without a window that is painted in, also as a child process that a test may kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from degense.app.features.annotate.state import AnnotationState
from degense.app.session.session import Session
from degense.app.session.state import PersistentState
from degense.engine.annotation.painting import PixelRegion
from degense.engine.errors import PromptError, RunError


class FakeScene:
    """What the session uses of a scene."""

    def __init__(self, folder: Path, frames: int = 10) -> None:
        self.name, self.frames, self.clip_size, self.clip = "fake", frames, (48, 40), None
        self.classes = ("liver", "grasper")
        self.run = SimpleNamespace(path=folder)

    def labels(self, frame: int) -> None:
        return None

    def question(self, prompt: str) -> None:
        if prompt == "xyzzy":
            raise PromptError("'xyzzy' is not in the vocabulary.")


class FakeClip:
    """What the session uses of a clip."""

    def __init__(self, folder: Path) -> None:
        self.path, self.name, self.size, self.classes = folder, "fake", (480, 40), ("liver", "grasper")

    def __len__(self) -> int:
        return 10

    def labels(self, frame: int) -> None:
        return None


class Strokes(PersistentState):
    """A state whose changes are small records of something that grows."""

    def __init__(self) -> None:
        super().__init__()
        self.strokes: list[int] = []
        self.weight = 0

    def add(self, stroke: int) -> None:
        self.strokes.append(stroke)
        self.changed.emit({"stroke": stroke})

    def clear(self) -> None:
        self.strokes = []

    def to_json(self) -> dict:
        return {"strokes": list(self.strokes), "weight": "x" * self.weight}

    def from_json(self, data, source) -> None:
        if not isinstance(data, dict) or not isinstance(data.get("strokes"), list):
            raise RunError(f"{source} holds no strokes")
        self.strokes = [int(stroke) for stroke in data["strokes"]]

    def replay(self, record, source) -> None:
        self.strokes.append(int(record["stroke"]))


def opened(folder: Path) -> tuple[Session, Strokes]:
    session, strokes = Session(), Strokes()
    session.register("strokes", strokes)
    session.open_scene(FakeScene(folder))
    return session, strokes


def annotating() -> tuple[Session, AnnotationState]:
    """A session with annotations."""
    session = Session()
    annotations = AnnotationState(session)
    session.register("annotations", annotations)
    return session, annotations


def opened_clip(folder: Path) -> tuple[Session, AnnotationState]:
    session, annotations = annotating()
    session.open_clip(FakeClip(folder))
    return session, annotations


def _paint(folder: Path, save_every: int, weight: int) -> Iterator[int]:
    """Stroke by stroke, each number after it was written; a save every so many strokes."""
    session, strokes = opened(folder)
    strokes.weight = weight
    for stroke in range(10**9):
        strokes.add(stroke)
        yield stroke
        if save_every and stroke % save_every == save_every - 1:
            session.save()


def paint_clip(folder: Path, dabs: int) -> Iterator[int]:
    """Label one column after another of a clip without a run: in strokes of some dabs each (0: in one that never ends)."""
    _, annotations = opened_clip(folder)
    for column in range(FakeClip(folder).size[0]):
        if column == 0 or (dabs and column % dabs == 0):
            annotations.end()
            annotations.begin("Brush")
        annotations.dab(PixelRegion(0, column, np.ones((40, 1), bool)))
        yield column
        time.sleep(0.02)


def paint_and_kill(folder: Path, save_every: int | str = 0, weight: int = 0, seconds: float = 0.3) -> int:
    """Paint in a child process and `kill -9` it `seconds` after its first stroke; the last stroke it had printed."""
    command = [sys.executable, "-m", "tests.app.painting", str(folder), str(save_every), str(weight)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        printed = [child.stdout.readline()]
        time.sleep(seconds)
        os.kill(child.pid, signal.SIGKILL)
        printed += child.stdout.read().splitlines()
    assert child.returncode == -signal.SIGKILL
    return int(next(line for line in reversed(printed) if line.strip().isdigit()))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    numbers = paint_clip(folder, int(sys.argv[3])) if sys.argv[2] == "clip" else _paint(folder, int(sys.argv[2]), int(sys.argv[3]))
    for number in numbers:
        print(number, flush=True)
