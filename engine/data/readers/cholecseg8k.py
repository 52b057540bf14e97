"""Raw CholecSeg8k: `videoNN_SSSSS/frame_<k>_endo.png` with its watershed, colour and annotation masks.

Classes and codes are those of the data set's published table. Two more values occur in the files: 255 (white outlines) and 0 (never
segmented); both say nothing.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from degense.engine.clip import UNLABELLED, Clip, held_out
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import guessed_cameras
from degense.engine.data.files.images import ImageFiles, check_sizes, checked, read_raw
from degense.engine.data.files.labels import ColourCodes, ColourMaps, index_maps
from degense.engine.data.files.masks import border_words, brightest, field_of_view
from degense.engine.data.files.numbered import list_files, regular_file, shown
from degense.engine.data.files.stored import clip_with_prior, colour_map_words, counted, looked_at, map_words, sampled
from degense.engine.errors import ClipError

#: name, grey code in the watershed mask, colour in the colour mask
CLASSES: tuple[tuple[str, int, tuple[int, int, int]], ...] = (
    ("Black Background", 50, (127, 127, 127)),
    ("Abdominal Wall", 11, (210, 140, 140)),
    ("Liver", 21, (255, 114, 114)),
    ("Gastrointestinal Tract", 13, (231, 70, 156)),
    ("Fat", 12, (186, 183, 75)),
    ("Grasper", 31, (170, 255, 0)),
    ("Connective Tissue", 23, (255, 85, 0)),
    ("Blood", 24, (255, 0, 0)),
    ("Cystic Duct", 25, (255, 255, 0)),
    ("L-hook Electrocautery", 32, (169, 255, 184)),
    ("Gallbladder", 22, (255, 160, 165)),
    ("Hepatic Vein", 33, (0, 50, 128)),
    ("Liver Ligament", 5, (111, 74, 0)),
)
NAMES = tuple(name for name, _, _ in CLASSES)
BACKGROUND = 0
FRAME = re.compile(r"frame_(\d+)_endo\.png")
_GREY = np.full(256, UNLABELLED, np.uint8)
_GREY[[code for _, code, _ in CLASSES]] = np.arange(len(CLASSES))
CODES = ColourCodes(colour for _, _, colour in CLASSES)


def from_watershed(mask: np.ndarray) -> np.ndarray:
    """Label map of a watershed mask, uint8 [H, W] or [H, W, C] with equal channels and alpha at will; unknown codes → `UNLABELLED`."""
    grey = mask if mask.ndim == 2 else mask[..., 0]
    labels = _GREY[grey]
    if mask.ndim == 3 and mask.shape[2] >= 3:
        labels[(mask[..., 1] != grey) | (mask[..., 2] != grey)] = UNLABELLED
    return labels


class CholecMaps(ColourMaps):
    """Label maps of a CholecSeg8k clip, from watershed masks where there are any, else from colour masks."""

    def read(self, index: int) -> np.ndarray:
        path = self.files[index]
        if path.name.endswith("_color_mask.png"):
            return super().read(index)
        raw = checked(read_raw(path), path, self.size)
        if raw.dtype != np.uint8:
            raise ClipError(f"{shown(path)} has {raw.dtype} values, but a watershed mask is an 8-bit picture.")
        return from_watershed(raw)


def cholec_frames(path: Path) -> list[Path]:
    """The frames of a CholecSeg8k clip folder by their number; empty when it is none. ClipError for links that lead out of the folder."""
    found = [(int(match.group(1)), f) for f in path.iterdir() if (match := FRAME.fullmatch(f.name))]
    return [regular_file(f, path) for _, f in sorted(found)]


def open_cholecseg8k(path: Path, options: ClipOptions) -> Clip:
    """Open one clip of the raw data set. ClipError when it cannot be read."""
    frames = cholec_frames(path)
    if not frames:
        raise ClipError(f"{shown(path)} holds no frame_<number>_endo.png.")
    pictures = ImageFiles(frames)
    size, count = pictures.size, len(frames)
    masks, kinds = _mask_files(path, frames)
    check_sizes(masks.values(), size)
    maps = CholecMaps(masks, CODES, size)
    strokes = index_maps(path, frames, size, "strokes", NAMES)
    some = [pictures.read(i) for i in looked_at(count)]
    field, field_words = _field(maps, some, count)
    source = f"13 classes, from {' and '.join(f'{kind} masks' for kind in kinds)}"
    words = {
        "frames": counted(frames, size),
        "masks": field_words,
        "labels": colour_map_words(maps, count, source, "carry no class's code (outlines, gaps)"),
        **map_words(strokes, count, "strokes"),
    }
    cameras, classes = guessed_cameras(count, size, field, options), NAMES if masks or strokes else ()
    found = maps if masks else None
    return clip_with_prior(path, pictures, some, field, cameras, words, classes=classes, label_maps=found, stroke_maps=strokes)


def _mask_files(path: Path, frames: list[Path]) -> tuple[dict[int, Path], list[str]]:
    there = {f.name: f for f in list_files(path, path, (".png",))}
    masks: dict[int, Path] = {}
    kinds: dict[str, None] = {}
    for i, frame in enumerate(frames):
        for kind, ending in (("watershed", "_watershed_mask.png"), ("colour", "_color_mask.png")):
            name = frame.stem + ending
            if name in there:
                masks[i] = there[name]
                kinds[kind] = None
                break
    return masks, list(kinds)


def _field(maps: CholecMaps, few: list[np.ndarray], count: int) -> tuple[np.ndarray | None, str]:
    """The field of view: what some label map of a frame that is trained on does not call background, else what is not a dark border."""
    if keys := sorted(set(maps.files) - set(held_out(count))):
        outside = np.all([maps.read(keys[i]) == BACKGROUND for i in sampled(len(keys))], axis=0)
        if 0.002 < outside.mean() < 0.95:
            hull = field_of_view(np.where(outside, 0, 255).astype(np.uint8))  # also takes the white outlines on the border away
            inside = ~outside if hull is None else hull & ~outside
            return inside, border_words(inside, "labelled Black Background")
    inside_border = field_of_view(brightest(few))
    return inside_border, border_words(inside_border, "dark border")
