"""What a disk holds of a folder after a power cut, from the system calls that were made on what was there before.

A sync keeps a file's bytes, or the folder's names. Of the sectors that were written since, the disk holds none or any; of the names those
of the last sync, or all.
"""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from degense.app.research.reliability.kills.system_calls import REFUSED, Call
from degense.engine.errors import DegenseError

SECTOR = 512


@dataclass
class Contents:
    """The bytes of a file at its last sync, and what was done since: bytes at a place, or a length."""

    kept: bytearray = field(default_factory=bytearray)
    since: list[tuple[int, bytes | None]] = field(default_factory=list)

    def sync(self) -> None:
        self.kept = self.after(1.0, random.Random(0))
        self.since = []

    def after(self, share: float, rng: random.Random) -> bytearray:
        """The bytes when about a share of the sectors written since the last sync have come to the disk."""
        found = bytearray(self.kept)
        for place, data in self.since:
            if data is None and rng.random() < share:
                found[place:] = bytes(max(0, place - len(found)))
            for start in range(0, len(data or b""), SECTOR):
                if data is not None and rng.random() < share:
                    piece, at = data[start : start + SECTOR], place + start
                    found.extend(bytes(max(0, at + len(piece) - len(found))))
                    found[at : at + len(piece)] = piece
        return found


class Disk:
    """A folder whose own files change; what lies in folders in it stays."""

    def __init__(self, root: Path, before: Path) -> None:
        self._root, self._before = os.fsencode(root), before
        files = [path for path in before.iterdir() if path.is_file()]
        self._names = {os.fsencode(path.name): Contents(bytearray(path.read_bytes())) for path in files}
        self._kept = dict(self._names)
        self._open: dict[int, tuple[Contents | None, int]] = {}  # by handle: a file, or the folder itself; and where it is written on

    def do(self, calls: Iterable[Call]) -> None:
        """DegenseError for a call that changes the folder in a way that is not known."""
        for call in calls:
            if call.name in REFUSED:
                if any(self._name(text) for text in call.texts):
                    raise DegenseError(f"The model of a power cut does not know what {call.name} does.")
            elif call.name == "openat":
                self._opened(call)
            elif call.name == "rename":
                self._renamed(*map(self._name, call.texts))
            elif call.name in ("unlink", "unlinkat"):
                self._names.pop(self._name(call.texts[0]) or b"", None)
            elif call.handle in self._open:
                self._used(call)

    def _name(self, path: bytes) -> bytes | None:
        """Of a file in the folder; None for one elsewhere."""
        folder, _, name = path.rpartition(b"/")
        return name if folder == self._root else None

    def _opened(self, call: Call) -> None:
        self._open.pop(call.result, None)
        [path], flags = call.texts, call.words.rpartition('"')[2]
        if path == self._root:
            self._open[call.result] = None, 0
        elif (name := self._name(path)) is not None:
            found = self._names.setdefault(name, Contents())
            if "O_TRUNC" in flags:
                found.since.append((0, None))
            self._open[call.result] = found, len(found.after(1.0, random.Random(0))) if "O_APPEND" in flags else 0

    def _renamed(self, old: bytes | None, new: bytes | None) -> None:
        moved = self._names.pop(old, None) if old is not None else None
        if new is not None:
            if moved is None:
                raise DegenseError("The model of a power cut does not know what was moved into the folder.")
            self._names[new] = moved

    def _used(self, call: Call) -> None:
        file, at = self._open[call.handle]
        if call.name == "close":
            del self._open[call.handle]
        elif file is None:
            self._kept = dict(self._names) if call.name in ("fsync", "fdatasync") else self._kept
        elif call.name in ("fsync", "fdatasync"):
            file.sync()
        elif call.name == "lseek":
            self._open[call.handle] = file, call.result
        elif call.name == "ftruncate":
            file.since.append((call.number(-1), None))
        elif call.name in ("write", "pwrite64"):
            place = at if call.name == "write" else call.number(-1)
            file.since.append((place, call.texts[0][: call.result]))
            self._open[call.handle] = file, at + call.result if call.name == "write" else at

    def lay_out(self, target: Path, rng: random.Random) -> None:
        """Write what is left into the new folder `target`: nothing of what was not synced, or some of it."""
        shutil.copytree(self._before, target)
        names, share = rng.choice((self._names, self._kept)), rng.choice((0.0, 0.5))
        for path in target.iterdir():
            if path.is_file():
                path.unlink()
        for name, contents in names.items():
            Path(os.fsdecode(os.path.join(os.fsencode(target), name))).write_bytes(contents.after(share, rng))
