"""Long clips that take little room: a picture that slides to and fro, its files linked again and again."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

PICTURES = 40


def sliding(index: int, width: int, height: int) -> np.ndarray:
    """One of `PICTURES` pictures, RGB uint8 [H, W, 3]: tissue-coloured texture, 2 pixels further each time up to the middle, then back."""
    noise = cv2.GaussianBlur(np.random.default_rng(0).standard_normal((height, width + 2 * PICTURES)).astype(np.float32), (0, 0), 3)
    value = 150 + 60 * noise / np.abs(noise).max()
    start = 2 * min(index, PICTURES - index)
    return np.stack([value, 0.5 * value, 0.45 * value], -1)[:, start : start + width].astype(np.uint8)


def write_pictures(folder: Path, frames: int, width: int, height: int, classes: Sequence[str] = ("liver", "gallbladder")) -> None:
    """Pictures, masks of a moving tool (255), label maps with a stripe for each class, and depth, in the *frames* layout."""
    for name in ("images", "masks", "labels", "depth"):
        (folder / name).mkdir(parents=True)
    (folder / "classes.json").write_text(json.dumps({"classes": list(classes)}), encoding="utf-8")
    labels = np.tile((np.arange(width) * len(classes) // width).astype(np.uint8), (height, 1))
    depth = (1000 + 200 * np.hypot(*np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height)))).astype(np.uint16)
    for i in range(min(frames, PICTURES)):
        tool = np.zeros((height, width), np.uint8)
        tool[: height // 3, i * width // PICTURES :][:, : width // 12] = 255
        stem = f"{i:06d}"
        files = {
            f"images/{stem}.jpg": sliding(i, width, height)[..., ::-1],
            f"masks/{stem}.png": tool,
            f"labels/{stem}.png": labels,
            f"depth/{stem}.png": depth,
        }
        for name, picture in files.items():
            (folder / name).write_bytes(cv2.imencode(Path(name).suffix, picture)[1].tobytes())
    for i in range(PICTURES, frames):
        for name, ending in (("images", "jpg"), ("masks", "png"), ("labels", "png"), ("depth", "png")):
            os.link(folder / name / f"{i % PICTURES:06d}.{ending}", folder / name / f"{i:06d}.{ending}")


def write_video(path: Path, frames: int, width: int, height: int) -> None:
    """The same pictures as a video."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25, (width, height))
    pictures = [np.ascontiguousarray(sliding(i, width, height)[..., ::-1]) for i in range(PICTURES)]
    for i in range(frames):
        writer.write(pictures[i % PICTURES])
    writer.release()
