"""A session without a window that is painted in, also as a child process that a test may kill."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from degense.app.session.persistent_state import PersistentState
from degense.app.session.session import Session
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

    def included(self, prompt: str) -> None:
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
    """A part whose changes are small records of something that grows."""

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


def _paint(folder: Path, save_every: int, weight: int) -> Iterator[int]:
    """Stroke by stroke, each number after it was told; a save every so many strokes."""
    session, strokes = opened(folder)
    strokes.weight = weight
    for stroke in range(10**9):
        strokes.add(stroke)
        yield stroke
        if save_every and stroke % save_every == save_every - 1:
            session.save()


def paint_clip(folder: Path, dabs: int) -> Iterator[int]:
    """Label one column after another of a clip without a run: in strokes of some dabs each (0: in one that never ends)."""
    session = Session()
    session.open_clip(FakeClip(folder))
    annotations = session.annotations
    for column in range(FakeClip(folder).size[0]):
        if column == 0 or (dabs and column % dabs == 0):
            annotations.end()
            annotations.begin("Brush")
        annotations.dab(PixelRegion(0, column, np.ones((40, 1), bool)))
        yield column
        time.sleep(0.02)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    numbers = paint_clip(folder, int(sys.argv[3])) if sys.argv[2] == "clip" else _paint(folder, int(sys.argv[2]), int(sys.argv[3]))
    for number in numbers:
        print(number, flush=True)
