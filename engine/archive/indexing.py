"""Bringing an index up to date: new and changed runs are looked through, those that are gone are forgotten."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from filelock import FileLock, Timeout

from degense.engine.archive.index_file import INDEX, MOST_RUNS, create_index, open_index
from degense.engine.archive.observed import observe
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps
from degense.engine.scene import Scene

LOCK = ".degense-index.lock"
#: Folders below the archive that are looked into, and the files of a run that its answers depend on.
DEPTH = 4
FILES = ("run.json", *(f"{name}.safetensors" for name in ("model", "basis", "text_vectors", "observability", "label_support")))


@dataclass
class Update:
    """What was done."""

    indexed: list[PurePosixPath] = field(default_factory=list)
    broken: list[tuple[PurePosixPath, str]] = field(default_factory=list)  # of those that were looked at now
    forgotten: int = 0
    busy: bool = False  # another program was indexing, so nothing was done


def find_runs(folder: Path) -> list[PurePosixPath]:
    """Run folders in a folder, by path; links and hidden folders are left out. DegenseError when it cannot be read."""
    if not folder.is_dir():
        raise DegenseError(f"{folder} is no folder; name one with runs in it.")
    return sorted(PurePosixPath(path.relative_to(folder).as_posix()) for path in _runs_in(folder, DEPTH))[:MOST_RUNS]


def _runs_in(folder: Path, depth: int) -> Iterator[Path]:
    try:
        with os.scandir(folder) as entries:
            inside = [Path(entry.path) for entry in entries if entry.is_dir(follow_symlinks=False) and not entry.name.startswith(".")]
    except OSError as error:
        if depth == DEPTH:
            raise DegenseError(f"{folder} cannot be read: {error.strerror}.") from error
        return
    for path in inside:
        if (path / "run.json").is_file():
            yield path
        elif depth > 1:
            yield from _runs_in(path, depth - 1)


def stamp(run: Path) -> str:
    """Changes with what an index keeps of a run: sizes and times of its files."""
    digest = hashlib.sha256()
    for name in FILES:
        try:
            about = (run / name).stat()
            digest.update(f"{name} {about.st_size} {about.st_mtime_ns}\n".encode())
        except OSError:
            digest.update(f"{name} none\n".encode())
    return digest.hexdigest()[:32]


def update_index(folder: Path) -> Steps[Update]:
    """Make the index of a folder, or bring it up to date. A run is written when it is looked through, so what is stopped goes on there.

    A run that cannot be opened is kept with the reason, and tried again when it has changed. Only one program at a time indexes.
    DegenseError when the folder cannot be written or its index is not ours.
    """
    done, path = Update(), folder / INDEX
    try:
        here = find_runs(folder)
        with FileLock(folder / LOCK, timeout=0):
            if not (path.exists() or path.is_symlink()):
                create_index(path)
            with open_index(path, write=True) as index:  # to be read only, one whose writer was cut off is refused
                known = {run.path: run.stamp for run in index.runs()}
            stamps = {run: stamp(folder / run) for run in here}
            gone, wanted = known.keys() - {*here}, [run for run in here if known.get(run) != stamps[run]]
            if not (gone or wanted):
                return done
            with open_index(path, write=True) as index:
                index.remove(gone)
                done.forgotten = len(gone)
                for number, run in enumerate(wanted):
                    try:
                        steps = observe(Scene.open(folder / run))
                        while True:
                            fraction, message = next(steps)
                            yield (number + fraction) / len(wanted), f"run {number + 1} of {len(wanted)}: {message}"
                    except StopIteration as stop:
                        index.put(run, stamps[run], stop.value)
                        done.indexed.append(run)
                    except DegenseError as error:
                        index.put(run, stamps[run], None, str(error))
                        done.broken.append((run, str(error)))
    except Timeout:
        done.busy = True
    except OSError as error:
        raise DegenseError(f"{folder} cannot be written ({error.strerror}); its index can only be read, with --as-is.") from error
    return done
