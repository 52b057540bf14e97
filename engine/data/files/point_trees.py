"""Points that data sets keep in a folder with their clip: STIR, VL-SurgPT and SurgT."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from degense.engine.data.files.images import read_raw
from degense.engine.data.files.numbered import regular_file, shown
from degense.engine.data.files.surgt_case import INFO, read_boxes, read_case
from degense.engine.errors import ClipError

LABELS = ("labels.json", "annotation/labels.json", "segmentation/labels.json")  # of VL-SurgPT
START, END = "segmentation/icgstartseg.png", "segmentation/icgendseg.png"  # of STIR


def sequence_of(path: Path) -> Path | None:
    """The folder of the sequence that a path is: a folder, or a file by which a data set is chosen; None for any other file."""
    if path.is_dir():
        return path
    if path.name in (Path(START).name, Path(END).name):
        return path.parent.parent
    return path.parent if path.name == INFO else None


def labels_of(folder: Path) -> Path | None:
    """The file of points of a sequence of VL-SurgPT, None where it has none. ClipError for a link that leads out of it."""
    return next((regular_file(folder / name, folder) for name in LABELS if (folder / name).exists()), None)


def surgt_points(folder: Path, frames: int, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Where the tissue of a case of SurgT is, float64 [K, T, 2], pixels of a clip of a size, and bool [K, T], not visible."""
    case = read_case(folder)
    if not case.truth:
        raise ClipError(f"{shown(folder / INFO)} names no ground truth.")
    pixels, hidden = zip(*(read_boxes(file, frames) for file in case.truth), strict=True)
    return np.stack(pixels) * (np.array(size) / case.size), np.stack(hidden)


def tattoos(folder: Path, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the tattoos of a sequence of STIR in its first and in its last frame, float64 [K, 2] and [E, 2], pixels of a clip.

    Nothing says which became which. `size` is the clip's. ClipError when there are none.
    """
    if not (folder / START).exists() or not (folder / END).exists():
        raise ClipError(f"{shown(folder)} holds no points: neither labels.json, nor {START} and {END}, nor {INFO} of a case of SurgT.")
    first, last = (_middles(regular_file(folder / name, folder), size) for name in (START, END))
    if not len(first) or not len(last):
        raise ClipError(f"{shown(folder / START)} or the picture of the end beside it shows no tattoo.")
    return first, last


def _middles(path: Path, size: tuple[int, int]) -> np.ndarray:
    raw = read_raw(path)
    marked = (raw[..., :3].max(-1) if raw.ndim == 3 else raw) > 0
    outlines, _ = cv2.findContours(marked.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    boxes = np.array([cv2.boundingRect(outline) for outline in outlines], np.float64).reshape(-1, 4)
    scale = np.array(size) / (marked.shape[1], marked.shape[0])
    return (boxes[:, :2] + boxes[:, 2:] / 2) * scale
