"""Clips that nobody wants: a small phantom, spoilt."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from degense.engine.data.synthetic import PhantomOptions, make_phantom

WIDTH, HEIGHT, FRAMES = 64, 48, 12
FIRST, HELD_OUT, MIDDLE = 0, (1, 9), 5


@dataclass(frozen=True)
class ClipCase:
    """A clip to open, train on and score.

    Attributes
    ----------
    name : str
    spoil : callable
        Changes the files of a sound clip in its folder.
    refused : bool
        Whether it cannot be used and must be refused in one sentence; else it must train.
    frames, width, height : int
    """

    name: str
    spoil: Callable[[Path], object]
    refused: bool = False
    frames: int = FRAMES
    width: int = WIDTH
    height: int = HEIGHT

    def make(self, folder: Path) -> Path:
        """Write the clip."""
        make_phantom(folder, PhantomOptions(self.frames, self.width, self.height))
        self.spoil(folder)
        return folder


def clip_cases() -> list[ClipCase]:
    """All of them; the first is sound."""
    return [
        ClipCase("sound", lambda folder: None),
        ClipCase("1 frame", lambda folder: None, frames=1),
        ClipCase("2 frames", lambda folder: None, frames=2),
        ClipCase("3 frames", lambda folder: None, frames=3),
        ClipCase("32 × 32 pixels", lambda folder: None, width=32, height=32),
        ClipCase("black frames", lambda folder: paint(folder, lambda image: image * 0)),
        ClipCase("white frames", lambda folder: paint(folder, lambda image: image * 0 + 255)),
        ClipCase("one colour", lambda folder: paint(folder, lambda image: image * 0 + np.array([150, 60, 50], np.uint8))),
        ClipCase("noise", lambda folder: paint(folder, lambda image: np.random.default_rng(0).integers(0, 256, image.shape, np.uint8))),
        ClipCase("one black frame", lambda folder: paint(folder, lambda image: image * 0, [MIDDLE])),
        ClipCase("first frame black", lambda folder: paint(folder, lambda image: image * 0, [FIRST])),
        ClipCase("no depth files, black frames", lambda folder: without_depth(folder, lambda image: image * 0)),
        ClipCase("no depth files, one colour", lambda folder: without_depth(folder, lambda image: image * 0 + 99)),
        ClipCase("one frame masked whole", lambda folder: mask(folder, lambda i: np.full((HEIGHT, WIDTH), i == MIDDLE))),
        ClipCase("first frame masked whole", lambda folder: mask(folder, lambda i: np.full((HEIGHT, WIDTH), i == FIRST))),
        ClipCase("held-out frames masked whole", lambda folder: mask(folder, lambda i: np.full((HEIGHT, WIDTH), i in HELD_OUT))),
        ClipCase("training frames masked whole", lambda folder: mask(folder, lambda i: np.full((HEIGHT, WIDTH), i not in HELD_OUT)), True),
        ClipCase("moving mask", lambda folder: mask(folder, lambda i: np.arange(WIDTH)[None] // 8 == np.full((HEIGHT, 1), i % 8))),
        ClipCase(
            "all but one pixel masked",
            lambda folder: mask(folder, lambda i: np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH) != 1500),
            True,
        ),
        ClipCase("one class", lambda folder: relabel(folder, lambda labels, i: labels * 0, ["liver"])),
        ClipCase("classes that no frame shows", lambda folder: relabel(folder, lambda labels, i: np.minimum(labels, 1))),
        ClipCase("a class in held-out frames only", lambda folder: relabel(folder, lambda labels, i: labels * (i in HELD_OUT))),
        ClipCase("labels that say nothing", lambda folder: relabel(folder, lambda labels, i: labels * 0 + np.uint8(255)), True),
        ClipCase("a class that no word means", lambda folder: relabel(folder, lambda labels, i: labels * 0, ["zxqv"])),
        ClipCase("NaN, infinite and negative pixels in depth", lambda folder: reach(folder, dotted)),
        ClipCase("depth unknown in one frame", lambda folder: reach(folder, lambda depth, i: depth * np.nan if i == MIDDLE else depth)),
        ClipCase(
            "depth unknown in the first frame", lambda folder: reach(folder, lambda depth, i: depth * np.nan if i == FIRST else depth)
        ),
        ClipCase("depth unknown everywhere", lambda folder: reach(folder, lambda depth, i: depth * np.nan), True),
        ClipCase("depth of 1e30", lambda folder: reach(folder, lambda depth, i: depth * 0 + 1e30)),
        ClipCase("depth of 1e-30", lambda folder: reach(folder, lambda depth, i: depth * 0 + 1e-30)),
        ClipCase("a few pixels of depth 1e30", lambda folder: reach(folder, spiked)),
        ClipCase("depth flat", lambda folder: reach(folder, lambda depth, i: depth * 0 + 70)),
        ClipCase("depth float16", lambda folder: reach(folder, lambda depth, i: depth.astype(np.float16))),
    ]


def dotted(depth: np.ndarray, index: int) -> np.ndarray:
    """Depth with a tenth each of NaN, infinity and negative values."""
    dice = np.random.default_rng(index).random(depth.shape)
    return np.select([dice < 0.1, dice < 0.2, dice < 0.3], [np.nan, np.inf, -depth], depth)


def spiked(depth: np.ndarray, index: int) -> np.ndarray:
    """Depth with one pixel in a hundred absurdly far."""
    return np.where(np.random.default_rng(index).random(depth.shape) < 0.01, 1e30, depth)


def paint(folder: Path, change: Callable[[np.ndarray], np.ndarray], only: list[int] | None = None) -> None:
    """Change pictures."""
    for i, file in enumerate(sorted((folder / "images").iterdir())):
        if only is None or i in only:
            Image.fromarray(change(np.array(Image.open(file))).astype(np.uint8)).save(file)


def mask(folder: Path, tool: Callable[[int], np.ndarray]) -> None:
    """Add masks, 255 = tool; `tool(index)` gives bool [H, W]."""
    (folder / "masks").mkdir()
    for i, file in enumerate(sorted((folder / "images").iterdir())):
        Image.fromarray(tool(i).astype(np.uint8) * np.uint8(255)).save(folder / "masks" / file.name)


def relabel(folder: Path, change: Callable[[np.ndarray, int], np.ndarray], classes: list[str] | None = None) -> None:
    """Change label maps, and the names of their classes."""
    for i, file in enumerate(sorted((folder / "labels").iterdir())):
        Image.fromarray(change(np.array(Image.open(file)), i).astype(np.uint8)).save(file)
    if classes is not None:
        (folder / "classes.json").write_text(json.dumps({"classes": classes}), encoding="utf-8")


def reach(folder: Path, change: Callable[[np.ndarray, int], np.ndarray]) -> None:
    """Change depth maps."""
    for i, file in enumerate(sorted((folder / "depth").iterdir())):
        np.save(file, change(np.load(file), i))


def without_depth(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Take the depth maps away and change the pictures, which depth must then be guessed from."""
    shutil.rmtree(folder / "depth")
    paint(folder, change)
