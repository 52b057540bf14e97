"""Runs made of masks instead of a training, for indexes of them."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import cv2
import numpy as np

from degense.engine.archive.frame_facts import frame_facts
from degense.engine.archive.index_file import INDEX, create_index, open_index
from degense.engine.archive.names import Things
from degense.engine.archive.observed import ColumnTable, Observed

CLASSES = ("liver", "gallbladder", "fat", "grasper", "hook")
WIDTH, HEIGHT, FRAMES = 64, 48, 12


def blobs(random: np.random.Generator, classes=CLASSES) -> dict[str, np.ndarray]:
    """Masks of ellipses by class; some classes are absent, some masks overlap a little."""
    masks = {}
    for name in classes:
        drawn = np.zeros((HEIGHT, WIDTH), np.uint8)
        for _ in range(random.integers(0, 4)):
            centre, axes = random.integers(0, (WIDTH, HEIGHT)), random.integers(2, 12, 2)
            cv2.ellipse(drawn, centre.tolist(), axes.tolist(), 30, 0, 360, 1, 1 if random.random() < 0.2 else -1)
        masks[name] = drawn.astype(bool)
    return masks


def film(seed: int, classes=CLASSES) -> list[dict[str, np.ndarray]]:
    """Masks of all frames, those of kinds among them: what of their members' masks there is."""
    random, things = np.random.default_rng(seed), Things.of(classes, True)
    frames = [blobs(random, classes) for _ in range(FRAMES)]
    return [masks | {kind: np.logical_or.reduce([masks[name] for name in members]) for kind, members in things.kinds} for masks in frames]


def observed(frames: list[dict[str, np.ndarray]], classes=CLASSES, closed: bool = True) -> Observed:
    table = ColumnTable(len(frames))
    for number, masks in enumerate(frames):
        table.add(number, frame_facts(masks, classes))
    return Observed(len(frames), (WIDTH, HEIGHT), 25.0, "mm", Things.of(classes, closed), table.columns(), {0: b"jpeg"})


def archive(folder: Path, **runs: Observed) -> Path:
    """An index of made runs; its file."""
    create_index(folder / INDEX)
    with open_index(folder / INDEX, write=True) as index:
        for name, run in runs.items():
            index.put(PurePosixPath(name), "stamp", run)
    return folder / INDEX
