"""Writing files so that a reader sees the old one or the new one, never half, also after a power cut: contents are on the disk before their
name is, and the name before the writer goes on. Free of torch, for those who need not wait for it."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import chain, count
from pathlib import Path

from degense.engine.errors import DegenseError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` (same suffix) that replaces it when the block ends well and is removed when it does not.

    DegenseError when the folder cannot be made or written.
    """
    path = Path(path)
    try:
        make_folder(path.parent)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise DegenseError(f"{path} cannot be written: {error.strerror}; choose another place.") from error
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        move(temporary, path)
    except OSError as error:
        raise DegenseError(f"{path} cannot be written: {error.strerror or error}; what was there before is untouched.") from error
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path` that becomes it when the block ends well and is removed when it does not.

    DegenseError when the folder cannot be made, or something is in `path` already.
    """
    path = Path(path)
    if path.is_file() or (path.is_dir() and any(path.iterdir())):
        raise DegenseError(f"{path} is not empty; choose another folder.")
    try:
        make_folder(path.parent)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    except OSError as error:
        raise DegenseError(f"{path} cannot be written: {error.strerror}; choose another place.") from error
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        if path.is_dir():
            path.rmdir()
        move(temporary, path)
    except OSError as error:
        raise DegenseError(f"{path} cannot be written: {error.strerror or error}; nothing is there.") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def move(source: Path, target: Path) -> None:
    """Give a file, or a folder with all that is in it, its final name, in place of a file or an empty folder there; synced. OSError."""
    for folder, _, names in os.walk(source):
        for name in names:
            _sync(Path(folder, name))
        sync_folder(Path(folder))
    if not source.is_dir():
        _sync(source)
    os.replace(source, target)
    sync_folder(target.parent)


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, so that a power cut leaves them. OSError."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for folder in missing:
        sync_folder(folder.parent)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_folder(path: Path) -> None:
    """Keep the names in a folder. Windows, and some network drives, have no such call: they keep names by themselves or not at all."""
    with suppress(OSError):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8. Half a letter, as the name of a file may have, is written as JSON has it: \\ud800."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def _umask() -> int:
    """The process's umask. It can only be read by setting it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def free_path(path: Path) -> Path:
    """`path`, or the first of path-2, path-3, … that does not exist."""
    others = (path.with_name(f"{path.name}-{number}") for number in count(2))
    return next(free for free in chain([path], others) if not free.exists())
