"""Runs asked one by one, where an index cannot answer for them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from degense.engine.archive.index_file import IndexedRun
from degense.engine.archive.search import Hit
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps
from degense.engine.scene import Scene
from degense.engine.scene.moments import ask_clip
from degense.engine.semantics.prompts import PromptSet


def ask_runs(folder: Path, runs: Sequence[IndexedRun], text: str) -> Steps[tuple[list[Hit], list[tuple[IndexedRun, str]]]]:
    """Open runs of a folder and ask them; the hits, and why others could not be asked."""
    hits: list[Hit] = []
    refused: list[tuple[IndexedRun, str]] = []
    for number, run in enumerate(runs):
        try:
            steps = ask_clip(Scene.open(folder / run.path), PromptSet((text,)))
            while True:
                fraction, message = next(steps)
                yield (number + fraction) / len(runs), f"{run.path}, {message}"
        except StopIteration as stop:
            hits += [Hit(run, int(answer.kept.sum()), answer.moments) for answer in stop.value if answer.kept.any()]
        except DegenseError as error:
            refused.append((run, str(error)))
    return hits, refused
