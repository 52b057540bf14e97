"""The index file: one SQLite database beside the runs. A file that is not exactly one of ours is refused before SQLite reads its tables."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import starmap
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from degense.engine.archive.frame_facts import Key
from degense.engine.archive.layout import MOST_NAMES, MOST_RUN_ID, RUN_BITS, column_numbers, packed, unpacked
from degense.engine.archive.names import Things
from degense.engine.archive.observed import Observed
from degense.engine.errors import DegenseError
from degense.engine.files import replacing
from degense.engine.semantics.relations import CONTACT, ENCLOSED, NEAR
from degense.engine.untrusted import parse_json

INDEX = "degense-index.sqlite"
#: Changes with the tables and with what the columns mean.
APPLICATION, VERSION = 0x44474E53, 2
#: Of a damaged file SQLite may say what is wrong in letters that are none.
UNREADABLE = (sqlite3.Error, UnicodeDecodeError)
#: An index answers by the rules it was made with.
RULES = {"contact": CONTACT, "near": NEAR, "enclosed": ENCLOSED, "decoder": "rnse"}
TABLES = """
CREATE TABLE rules (text TEXT NOT NULL);
CREATE TABLE runs (id INTEGER PRIMARY KEY, path TEXT NOT NULL UNIQUE, stamp TEXT NOT NULL, facts TEXT NOT NULL, error TEXT NOT NULL);
CREATE TABLE columns (number INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE pictures (run INTEGER NOT NULL, frame INTEGER NOT NULL, jpeg BLOB NOT NULL, PRIMARY KEY (run, frame));
"""
#: What is believed of a file.
MOST_RUNS, MOST_FRAMES, MOST_CLASSES, LONGEST_TEXT = 100_000, 1_000_000, 255, 1 << 20
MOST_SIDE, MOST_PICTURE_BYTES = 16_384, 1 << 17
PAGE, BUSY_SECONDS = 16_384, 30.0


NOTHING = Things((), (), True)


@dataclass(frozen=True)
class IndexedRun:
    """A line of the table of runs."""

    id: int
    path: PurePosixPath  # from the folder of the index
    stamp: str  # of the files that were read
    error: str  # why it is not indexed, in one sentence; then the rest is empty
    frames: int = 0
    size: tuple[int, int] = (0, 0)
    fps: float = 1.0
    unit: str = ""
    things: Things = NOTHING


class IndexFile:
    """An open index. Every method raises DegenseError, in one sentence, where the file is damaged."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path, self._db = path, connection

    def runs(self) -> list[IndexedRun]:
        """By path. What the file says is checked: paths stay in its folder, numbers are possible."""
        rows = self._rows(f"SELECT id, path, stamp, error, facts FROM runs ORDER BY path LIMIT {MOST_RUNS}")
        try:
            return [_checked(*row) for row in rows]
        except (TypeError, ValueError, KeyError) as error:
            raise DegenseError(f"{self.path} is damaged; delete it, and it is made again.") from error

    def columns(self, things: Things, key: Key, lengths: dict[int, int]) -> dict[int, np.ndarray]:
        """A column of some runs with the same things, whose ids and lengths are given; those that have none are left out."""
        runs = dict(zip(column_numbers(lengths, things, [key]), lengths, strict=True))
        found: dict[int, np.ndarray] = {}
        for number, data in self._rows(f"SELECT number, data FROM columns WHERE number IN ({', '.join(map(str, runs))})"):
            try:
                found[runs[number]] = unpacked(key[0], data, lengths[runs[number]])
            except (TypeError, ValueError) as error:
                raise DegenseError(f"{self.path} is damaged; delete it, and it is made again.") from error
        return found

    def picture(self, run: int, frame: int) -> tuple[int, bytes] | None:
        """The picture nearest to a frame, as (frame, JPEG); None without any."""
        nearest = "SELECT frame FROM pictures WHERE run = ?1 ORDER BY abs(frame - ?2) LIMIT 1"
        rows = self._rows(f"SELECT frame, jpeg FROM pictures WHERE run = ?1 AND frame = ({nearest})", (run, frame))
        for at, jpeg in rows:
            if isinstance(at, int) and isinstance(jpeg, bytes) and len(jpeg) <= MOST_PICTURE_BYTES:
                return at, jpeg
        return None

    def put(self, path: PurePosixPath, stamp: str, run: Observed | None, error: str = "") -> None:
        """Write what was seen of a run, or why nothing was, in place of what is there: all of it or nothing."""
        facts = {} if run is None else {k: v for k, v in vars(run).items() if k not in ("columns", "pictures")}
        text = json.dumps(facts | ({"things": asdict(run.things)} if run is not None else {}))
        with self._writing():
            self._remove([path])
            row = self._db.execute(
                "INSERT INTO runs (path, stamp, facts, error) VALUES (?, ?, ?, ?)", (path.as_posix(), stamp, text, error)
            ).lastrowid
            if run is not None:
                assert row is not None
                numbers, blobs = column_numbers([row], run.things, run.columns), starmap(packed, run.columns.items())
                self._db.executemany("INSERT INTO columns VALUES (?, ?)", sorted(zip(numbers, blobs, strict=True)))
                self._db.executemany("INSERT INTO pictures VALUES (?, ?, ?)", ((row, *picture) for picture in run.pictures.items()))

    def remove(self, paths: Iterable[PurePosixPath]) -> None:
        """Forget runs."""
        with self._writing():
            self._remove(paths)

    def _remove(self, paths: Iterable[PurePosixPath]) -> None:
        for path in paths:
            for (run,) in self._db.execute("SELECT id FROM runs WHERE path = ?", (path.as_posix(),)).fetchall():
                self._db.execute("DELETE FROM columns WHERE number BETWEEN ? AND ?", (run << RUN_BITS, (run + 1 << RUN_BITS) - 1))
                self._db.execute("DELETE FROM pictures WHERE run = ?", (run,))
                self._db.execute("DELETE FROM runs WHERE id = ?", (run,))

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            self._db.execute("BEGIN IMMEDIATE")
            yield
            self._db.execute("COMMIT")
        except sqlite3.Error as error:
            raise DegenseError(f"{self.path} cannot be written ({error}); what was in it before is untouched.") from error
        finally:
            if self._db.in_transaction:
                self._db.rollback()

    def _rows(self, query: str, values: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        try:
            return self._db.execute(query, values).fetchall()
        except UNREADABLE as error:
            raise _unreadable(self.path, error) from error


def create_index(path: Path) -> None:
    """Make an empty index; it appears whole. DegenseError when it cannot be written."""
    pragmas = f"PRAGMA page_size = {PAGE}; PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {VERSION};"
    try:
        with replacing(path) as temporary, closing(sqlite3.connect(temporary)) as made:
            made.executescript(f"{pragmas} {TABLES}")
            made.execute("INSERT INTO rules VALUES (?)", (json.dumps(RULES),))
            made.commit()
    except sqlite3.Error as error:
        raise DegenseError(f"{path} cannot be written ({error}); free some space, or name another folder.") from error


@contextmanager
def open_index(path: Path, write: bool = False) -> Iterator[IndexFile]:
    """The index of a folder, to be read only unless `write`. DegenseError for what is none, is damaged, or is of another version."""
    _check_header(path)
    try:
        connection = sqlite3.connect(
            f"{path.resolve().as_uri()}?mode={'rw' if write else 'ro'}", uri=True, timeout=BUSY_SECONDS, isolation_level=None
        )
    except sqlite3.Error as error:
        raise DegenseError(f"{path} cannot be opened ({error}).") from error
    with closing(connection):
        try:
            connection.executescript(
                "PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0; PRAGMA cache_size = -65536;"
            )
            if not write:
                connection.execute("PRAGMA query_only = ON")
            tables = connection.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY name LIMIT 50").fetchall()
            rules = connection.execute("SELECT text FROM rules LIMIT 1").fetchall() if tables == _tables() else []
        except UNREADABLE as error:
            raise _unreadable(path, error) from error
        if tables != _tables():
            raise DegenseError(f"{path} holds other tables than an index of degense; move it away, and an index is made.")
        if rules != [(json.dumps(RULES),)]:
            raise DegenseError(f"{path} was made by other rules than those of this version; delete it, and it is made again.")
        yield IndexFile(path, connection)


def _unreadable(path: Path, error: Exception) -> DegenseError:
    why = f" ({error})" if isinstance(error, sqlite3.Error) else ""
    return DegenseError(f"{path} cannot be read{why}; if it is damaged, delete it, and it is made again.")


def _check_header(path: Path) -> None:
    """What the first bytes say; SQLite has not seen the file yet."""
    if path.is_symlink() or not path.is_file():
        raise DegenseError(f"{path} is no file of its own; move it away, and an index is made.")
    try:
        with path.open("rb") as file:
            head = file.read(100)
    except OSError as error:
        raise DegenseError(f"{path} cannot be read: {error.strerror}.") from error
    version, application = (int.from_bytes(head[at : at + 4], "big") for at in (60, 68))
    if head[:16] != b"SQLite format 3\0" or len(head) < 100 or head[18:20] != b"\1\1" or application != APPLICATION:
        raise DegenseError(f"{path} is not an index of degense; move it away, and an index is made.")
    if version != VERSION:
        raise DegenseError(f"{path} is of version {version}, and this program reads {VERSION}; delete it, and it is made again.")


def _tables() -> list[tuple[str]]:
    """As `sqlite_master` has them."""
    with closing(sqlite3.connect(":memory:")) as fresh:
        fresh.executescript(TABLES)
        return fresh.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY name").fetchall()


def _checked(number: Any, path: Any, stamp: Any, error: Any, facts: Any) -> IndexedRun:
    """A line of the table of runs. ValueError, TypeError or KeyError for an impossible one."""
    if not all(isinstance(text, str) and len(text) <= LONGEST_TEXT for text in (path, stamp, error, facts)):
        raise ValueError("no text")
    if type(number) is not int or not 0 < number <= MOST_RUN_ID:
        raise ValueError("no number of a run")
    place = PurePosixPath(path)
    if not {"", ".", ".."}.isdisjoint(path.split("/")) or not {"\\", ":", "\0"}.isdisjoint(path):
        raise ValueError("a path that leaves the folder")
    if error:
        return IndexedRun(number, place, stamp, error)
    return IndexedRun(number, place, stamp, "", *_facts(facts))


@lru_cache(maxsize=256)
def _facts(text: str) -> tuple[int, tuple[int, int], float, str, Things]:
    """Frames, size, frame rate, unit and things; runs of one kind of clip have them in common."""
    known = parse_json(text)
    frames, (width, height), fps = known["frames"], known["size"], float(known["fps"])
    classes, kinds = known["things"]["classes"], known["things"]["kinds"]
    sane = type(frames) is int and 1 <= frames <= MOST_FRAMES and 0 < fps < 1e6
    if not sane or not all(1 <= int(side) <= MOST_SIDE for side in (width, height)):
        raise ValueError("impossible numbers")
    things = Things(_texts(classes), tuple((_text(name), _texts(members)) for name, members in kinds), bool(known["things"]["closed"]))
    if len(things.names) > MOST_NAMES:
        raise ValueError("more things than can be numbered")
    return frames, (int(width), int(height)), fps, _text(known["unit"]), things


def _text(value: Any) -> str:
    if not isinstance(value, str) or len(value) > 1000:
        raise ValueError("no text")
    return value


def _texts(values: Any) -> tuple[str, ...]:
    if not isinstance(values, list) or len(values) > MOST_CLASSES:
        raise ValueError("no list")
    return tuple(map(_text, values))
