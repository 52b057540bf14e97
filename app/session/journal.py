"""The journal: changes since the last save, appended to a file as they happen, so that a crash does not lose them."""

from __future__ import annotations

import json
import os
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from degense.engine.errors import DegenseError
from degense.engine.files import sync_folder
from degense.engine.untrusted import parse_json, read_bytes

#: A journal larger than this is not ours: saving empties it every few minutes.
LARGEST = 256 << 20


@dataclass(frozen=True)
class Entry:
    """A change of the state with this name, as `PersistentState.replay` takes it."""

    state: str
    record: Any


class Journal:
    """An append-only file of small records: a header, then one JSON line each.

    The header names the session file that the records continue, by its id. A crash between saving and emptying the journal leaves records
    that are in the session file already; their journal names another file and is not read, so nothing is applied twice. While a session
    file is being written, which may take long, the journal goes on: a line names the file that will hold what stands before it.
    Records are handed to the system at once, without waiting for the disk: they survive any end of the program. `sync` has the disk keep
    them, in a thread of its own: called every second, a power cut loses two seconds at most.
    `after` is the id of the session file, empty for none, `begun` of one that is being written; `source` the run or clip, `folder` where
    it is saved.
    """

    def __init__(self, path: Path, after: str, source: Path, folder: Path, begun: str = "") -> None:
        self.path = path
        self._end = sum(size for _, size in _read(path)) if continues(path, after) else 0
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        except OSError as error:
            raise DegenseError(f"{path} cannot be written ({error.strerror}): a crash would lose what is not saved.") from error
        self._disk = ThreadPoolExecutor(1, "journal")
        self._syncing: Future[None] | None = None
        self._synced = self._end
        os.ftruncate(self._file, self._end)  # without what a crash left half written
        if not self._end:
            self._write({"journal": 1, "after": after, "source": str(source), "folder": str(folder)})
        if begun:
            self._write({"file": begun})
        sync_folder(path.parent)

    def append(self, state: str, record: Any) -> None:
        """Add a record. DegenseError when it cannot be written whole; the journal ends before it then, and later records may succeed."""
        self._write({"part": state, "record": record})

    def sync(self) -> None:
        """Have the disk keep what was appended, without waiting for it. DegenseError when the last time failed."""
        if self._syncing is not None and not self._syncing.done():
            return  # a slow disk: what came since is kept the next time
        failed = self._syncing.exception() if self._syncing is not None else None
        if failed is None and self._synced == self._end:
            return
        self._synced, self._syncing = self._end, self._disk.submit(os.fsync, self._file)
        if failed is not None:
            raise DegenseError(f"{self.path} cannot be written ({failed}): a power cut would lose what is not saved.") from failed

    def close(self) -> None:
        with suppress(DegenseError):  # it is said where records are appended
            self.sync()
        self._disk.submit(os.close, self._file)
        self._disk.shutdown(wait=False)  # a disk that stalls is waited for when the program ends

    def _write(self, line: dict[str, Any]) -> None:
        data = json.dumps(line, separators=(",", ":")).encode() + b"\n"
        try:
            os.lseek(self._file, self._end, os.SEEK_SET)
            written = os.write(self._file, data)
        except OSError as error:
            written, reason = 0, error.strerror or str(error)
        else:
            reason = "the disk is full"
        if written == len(data):
            self._end += written
            return
        with suppress(OSError):
            os.ftruncate(self._file, self._end)
        raise DegenseError(f"{self.path} cannot be written ({reason}): a crash would lose what is not saved.")


def continues(path: Path, after: str) -> bool:
    """Whether the journal at `path` continues the session file with this id."""
    return _since([line for line, _ in _read(path)], after) is not None


def header(path: Path) -> dict[str, Any]:
    """What the journal says of itself; empty where there is none."""
    return next((line for line, _ in _read(path)), {})


def entries(path: Path, after: str) -> list[Entry]:
    """The changes since the session file with the id `after`, up to the first line that a crash left half written."""
    lines = _since([line for line, _ in _read(path)], after) or []
    return [Entry(str(line["part"]), line["record"]) for line in lines if set(line) == {"part", "record"}]


def _since(lines: list[dict[str, Any]], after: str) -> list[dict[str, Any]] | None:
    """The lines that continue the session file with this id; None where none do."""
    if not lines or lines[0].get("journal") != 1:
        return None
    if lines[0].get("after") == after:
        return lines
    begun = [number for number, line in enumerate(lines) if line == {"file": after}]
    return lines[begun[-1] :] if begun else None


def _read(path: Path) -> list[tuple[dict[str, Any], int]]:
    """The whole lines of a file and their sizes in bytes; none where there is no file. DegenseError when it cannot be read."""
    try:
        data = read_bytes(path, LARGEST)
    except FileNotFoundError:
        return []
    except ValueError as error:
        raise DegenseError(f"{path} is no journal ({error}); move it away.") from error
    except OSError as error:
        raise DegenseError(f"{path} cannot be read: {error.strerror}.") from error
    lines: list[tuple[dict[str, Any], int]] = []
    for raw in data.splitlines(keepends=True):
        try:
            line = parse_json(raw) if raw.endswith(b"\n") else None
        except ValueError:
            line = None
        if not isinstance(line, dict):
            break
        lines.append((line, len(raw)))
    return lines
