"""Hears which places a call reads, lists and changes, so that an input that leads out of its folder is found, whatever is made of it then.

Python tells of files that are opened, folders that are listed, what is made, moved and removed, databases, programs and connections. It
does not tell of what is only looked for (stat), nor of files that compiled libraries open by themselves.
"""

from __future__ import annotations

import os
import site
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import degense.engine

#: Events by which something is read, with the place of its name among what an event tells.
READS = {"os.listdir": 0, "os.scandir": 0, "os.chdir": 0}
#: Those by which something is changed, with the places of names, each followed somewhere by the folder that it is relative to.
CHANGES: dict[str, tuple[tuple[int, int | None], ...]] = {
    "os.mkdir": ((0, 2),),
    "os.remove": ((0, 1),),
    "os.rmdir": ((0, 1),),
    "os.rename": ((0, 2), (1, 3)),
    "os.link": ((0, 2), (1, 3)),
    "os.symlink": ((1, 2),),
    "os.truncate": ((0, None),),
    "os.chmod": ((0, 2),),
    "os.chown": ((0, 3),),
    "os.utime": ((0, 3),),
}
#: Programs and connections: no input is a reason for them.
NEVER = ("os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "socket.connect", "socket.getaddrinfo")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
#: Where the system, the interpreter and the program itself lie: read without being asked to by an input.
LIBRARIES = tuple(
    Path(name).resolve()
    for name in {
        *("/dev", "/proc", "/sys", "/usr", "/lib", "/lib64", sys.prefix, sys.base_prefix, *site.getsitepackages()),
        *(*sysconfig.get_paths().values(), *filter(os.path.isabs, sys.path), str(Path(degense.engine.__file__).parents[1])),
    }
)


class Watch:
    """Lists in `left` what lay outside of the folders `own`; heard from when it is made to the end of the process."""

    def __init__(self, own: Sequence[Path]) -> None:
        self.own, self.left = [folder.resolve() for folder in own], list[str]()
        sys.addaudithook(self._hear)

    def _hear(self, event: str, told: tuple[object, ...]) -> None:
        if event == "open":
            self._go(told[0], self.own if isinstance(told[2], int) and told[2] & WRITING else (*self.own, *LIBRARIES), "opened")
        elif event in READS:
            self._go(told[READS[event]], (*self.own, *LIBRARIES), "listed")
        elif event == "sqlite3.connect":
            name = str(told[0]).removeprefix("file:").partition("?")[0]
            self._go(None if name in (":memory:", "") else name, self.own, "opened as a database")
        elif event in CHANGES:
            for at, folder in CHANGES[event]:
                inside = folder is not None and told[folder] not in (-1, None)
                self._go(None if inside else told[at], self.own, f"changed ({event})")
        elif event in NEVER:
            self.left.append(f"{event} {str(told[:2])[:80]} was called")

    def _go(self, name: object, allowed: Sequence[Path], what: str) -> None:
        """Note a name unless it lies below one of `allowed`; a number is a file that was opened before."""
        if isinstance(name, (str, bytes, os.PathLike)):
            place = Path(os.path.realpath(os.fsdecode(name)))
            if not any(place.is_relative_to(folder) for folder in allowed):
                self.left.append(f"{str(place)[:200]} was {what}")


def watched(read: Callable[[Path], object], path: Path, folder: Path, own: Path) -> None:
    """Read, and be at fault where anything outside of the input's `folder` and of `own`, which this process is given, was read or changed.

    Of a process that does nothing else afterwards: an audit hook stays.
    """
    own.mkdir(exist_ok=True)
    os.chdir(own)
    for name in ("TMPDIR", "XDG_CACHE_HOME", "XDG_STATE_HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME"):
        os.environ[name] = str(own)
    tempfile.tempdir, sys.dont_write_bytecode = str(own), True
    watch = Watch((folder, own))
    try:
        read(path)
    finally:
        assert not watch.left, f"{watch.left[0]}, which lies outside of the input"
