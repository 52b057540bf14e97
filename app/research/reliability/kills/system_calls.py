"""The system calls of a process, recorded by strace: programs may write and sync from C, as SQLite does."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from degense.engine.errors import DegenseError

#: Those that write, sync or name files; with those that `disk.Disk` refuses.
CALLS = ("openat", "write", "pwrite64", "lseek", "fsync", "fdatasync", "ftruncate", "unlink", "unlinkat", "rename", "close")
REFUSED = ("open", "creat", "truncate", "renameat", "renameat2", "link", "linkat")
LINE = re.compile(r"(\d+\.\d+) (\w+)\((.*)\) += (\d+)")
TEXT = re.compile(r'"((?:\\x[0-9a-f]{2})*)"(\.\.\.)?')
LONGEST_TEXT = 1 << 20
MISSING = "Not cut: a power cut of what SQLite writes is modelled with strace, which is not installed."


def missing() -> str:
    """Why nothing can be recorded here, in one sentence; empty where it can."""
    return "" if shutil.which("strace") else MISSING


def follow(process: int, log: Path) -> subprocess.Popen[bytes]:
    """Begin to write the calls of a process, which waits in `wait_to_be_followed`, into the folder `log`; the recorder ends with it."""
    log.mkdir()
    asked = ",".join(f"?{call}" for call in (*CALLS, *REFUSED))
    options = ["-ff", "-qq", "-ttt", "-xx", "-s", str(LONGEST_TEXT), "-e", "signal=none", "-e", f"trace={asked}"]
    return subprocess.Popen(["strace", *options, "-o", str(log / "calls"), "-p", str(process)], stderr=subprocess.DEVNULL)


def wait_to_be_followed(seconds: float = 20.0) -> None:
    """Return when the calls of this process are recorded. DegenseError when they are not by then."""
    end = time.monotonic() + seconds
    while "TracerPid:\t0\n" in Path("/proc/self/status").read_text(encoding="ascii"):
        if time.monotonic() > end:
            raise DegenseError("strace may not follow processes here (ptrace is not permitted).")
        time.sleep(0.01)


@dataclass(frozen=True)
class Call:
    name: str
    words: str  # between the brackets
    result: int
    texts: tuple[bytes, ...]

    @property
    def handle(self) -> int:
        return int(self.words.partition(",")[0])

    def number(self, place: int) -> int:
        """One of the arguments after the last text, or after the handle."""
        return int(self.words.rpartition('"')[2].split(", ")[place])


def calls(log: Path) -> list[Call]:
    """Those that succeeded, in the order in which they began. DegenseError where one was cut short."""
    found: list[tuple[float, Call]] = []
    for path in log.glob("calls.*"):
        for at, name, words, result in LINE.findall(path.read_text(encoding="ascii")):
            texts = TEXT.findall(words)
            if any(more for _, more in texts):
                raise DegenseError(f"A call of {name} is longer than is recorded.")
            found.append((float(at), Call(name, words, int(result), tuple(bytes.fromhex(text.replace("\\x", "")) for text, _ in texts))))
    return [call for _, call in sorted(found, key=lambda pair: pair[0])]
