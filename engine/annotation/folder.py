"""The folder `annotations/` of a run or clip: `annotations.json` and one indexed PNG a frame.

A PNG's name holds the check sum of its bytes and is never written twice, and the JSON, which names the PNGs, is replaced last: whatever
interrupts a save, the old state or the new one is there, whole.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from degense.engine.annotation.annotations import Annotations, Record
from degense.engine.annotation.edits import STATUSES, LabelClass, Proposal, check_classes, pack, unpack
from degense.engine.annotation.label_png import label_png, read_label_png
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError, RunError, what_is_wrong
from degense.engine.files import replacing, write_text
from degense.engine.untrusted import read_json

NAME, INDEX, FORMAT, LARGEST = "annotations", "annotations.json", 1, 64 << 20
FILE = re.compile(r"\d{1,9}-[0-9a-f]{8}\.png")


class StoredMap:
    """A label map on disk, read when it is called first and `kept` from then on, packed."""

    def __init__(self, path: Path, shape: tuple[int, int], classes: int, kept: bytes | None = None):
        self.path, self._shape, self._classes, self._kept = path, shape, classes, kept
        self.at_hand = kept is not None  # whether it has been read, or found damaged

    def __call__(self) -> np.ndarray:
        """uint8 [H, W]. RunError when the file is damaged."""
        if self._kept is None:
            try:
                self._kept = pack(self._read())
            finally:
                self.at_hand = True
        return unpack(self._kept, self._shape)

    def _read(self) -> np.ndarray:
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise RunError(f"{self.path} cannot be read ({error.strerror}); put it back from a backup.") from error
        if f"{zlib.crc32(data):08x}" != self.path.stem.rpartition("-")[2]:
            raise RunError(f"{self.path} is damaged; put it back from a backup.")
        labels = read_label_png(self.path, self._shape)
        if labels[labels != UNLABELLED].max(initial=0) >= max(1, self._classes):
            raise RunError(f"{self.path} has a label that {INDEX} does not name; put both back from one backup.")
        return labels

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StoredMap) and self.path == other.path

    def __hash__(self) -> int:
        return hash(self.path)


def save(annotations: Annotations, folder: Path) -> None:
    """Write everything that the folder does not hold yet.

    DegenseError when the folder cannot be written; what was there before still opens.
    """
    entries = {}
    for frame, record in sorted(annotations.records.items()):
        labels = record.labels
        if labels is not None and not (isinstance(labels, StoredMap) and labels.path.parent == folder):
            own = labels if isinstance(labels, bytes) else pack(labels())
            path = _write(folder, frame, unpack(own, annotations.shape), annotations)
            labels = StoredMap(path, annotations.shape, len(annotations.classes), own)
            annotations.records[frame] = Record(labels, record.by_hand, record.status, record.proposal)
        proposal = None
        if record.proposal is not None:
            written = _write(folder, frame, record.proposal.labels, annotations)
            proposal = {"labels": written.name, **record.proposal.numbers()}
        name = labels.path.name if isinstance(labels, StoredMap) else None
        entries[str(frame)] = {"labels": name, "by_hand": record.by_hand, "status": record.status, "carried": proposal}
    height, width = annotations.shape
    classes = [{"name": kind.name, "colour": kind.colour, "number": kind.number} for kind in annotations.classes]
    index = {"format": FORMAT, "size": [width, height], "count": annotations.count, "classes": classes, "frames": entries}
    write_text(folder / INDEX, json.dumps(index, indent=1))
    _remove_others(folder, entries)


def load(folder: Path, shape: tuple[int, int], count: int, original: Callable[[int], np.ndarray | None]) -> Annotations | None:
    """What `save` wrote; None when there is nothing. Label maps are read when they are looked at.

    RunError when something in the folder is damaged, missing, or belongs to another clip.
    """
    path = folder / INDEX
    try:
        data = read_json(path, LARGEST)
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise RunError(f"{path} cannot be read ({error}); put it back from a backup, or move the folder away to start anew.") from error
    try:
        return _annotations(data, folder, shape, count, original)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, DegenseError) as error:
        raise RunError(f"{path} does not hold annotations of this clip ({what_is_wrong(error)}); put it back from a backup.") from error


def _annotations(data: Any, folder: Path, shape: tuple[int, int], count: int, original: Callable[[int], np.ndarray | None]) -> Annotations:
    if int(data["format"]) > FORMAT:
        raise ValueError("it was written by a newer degense; update to open it")
    if (data["size"][1], data["size"][0], data["count"]) != (*shape, count):
        raise ValueError(f"it is for {data['count']} frames of {data['size'][0]} × {data['size'][1]}")
    classes = tuple(LabelClass.stored(item["name"], item["colour"], item.get("number", 1)) for item in data["classes"])
    check_classes(classes)
    annotations = Annotations(classes, shape, count, original)
    for key, entry in data["frames"].items():
        frame = int(key)
        if not 0 <= frame < count or entry["status"] not in STATUSES:
            raise ValueError(f"frame {key} makes no sense")
        labels = _stored(folder, entry["labels"], shape, len(classes)) if entry["labels"] is not None else None
        proposal = None
        if entry["carried"] is not None:
            proposed = _stored(folder, entry["carried"]["labels"], shape, len(classes))()
            proposal = Proposal.of(pack(proposed), shape, entry["carried"])
        annotations.records[frame] = Record(labels, bool(entry["by_hand"]), entry["status"], proposal)
    return annotations


def _stored(folder: Path, name: Any, shape: tuple[int, int], classes: int) -> StoredMap:
    if not isinstance(name, str) or not FILE.fullmatch(name):
        raise ValueError(f"{name!r} is no file name of a label map")
    path = folder / name
    if path.is_symlink() or not path.is_file():
        raise ValueError(f"{name} is missing")
    return StoredMap(path, shape, classes)


def _write(folder: Path, frame: int, labels: np.ndarray, annotations: Annotations) -> Path:
    data = label_png(labels, annotations.classes)
    path = folder / f"{frame:06d}-{zlib.crc32(data):08x}.png"
    if not path.exists() or path.stat().st_size != len(data):
        with replacing(path) as temporary:
            temporary.write_bytes(data)
    return path


def _remove_others(folder: Path, entries: dict[str, Any]) -> None:
    """Take away the maps that the index no longer names."""
    named = {name for entry in entries.values() for name in (entry["labels"], (entry["carried"] or {}).get("labels")) if name}
    for path in folder.iterdir():
        if FILE.fullmatch(path.name) and path.name not in named:
            path.unlink(missing_ok=True)
