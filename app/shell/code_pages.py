"""The code of libraries that ran once, such as what starts them up and loads compiled kernels, leaves memory.

PyTorch, LLVM and Qt are read from their files as they run; what is not run again stays in memory all the same: about 180 MB of the sample's
580 (docs/decisions/0062). What is needed again the system reads anew, from its cache of files.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterator
from pathlib import Path

#: Resident memory of files, bytes: the window works with some 110 MB; at rest more than `KEPT` is given back, at work than `MUCH`.
KEPT, MUCH = 120_000_000, 180_000_000
_DONT_NEED = 4  # of madvise, linux/mman.h
_CODE = re.compile(r"^([0-9a-f]+)-([0-9a-f]+) r-xp .* (/.*)$")


def give_code_back(library: ctypes.CDLL) -> None:
    """Let the system take the pages of code files, where they are many; Linux only. `library` is the C library."""
    if _resident() > KEPT:
        for start, end in _untouched():
            library.madvise(ctypes.c_void_p(start), ctypes.c_size_t(end - start), _DONT_NEED)


def much_code() -> bool:
    """Whether pages of files take more than `MUCH` of memory; Linux only."""
    return _resident() > MUCH


def _resident() -> int:
    """Memory of this process that holds pages of files, bytes."""
    found = re.search(r"^RssFile:\s+(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)
    return 1024 * int(found[1]) if found else 0


def _untouched() -> Iterator[tuple[int, int]]:
    """Where code lies that is as its file has it: not what a debugger has written into, say, which would be lost."""
    here: tuple[int, int] | None = None
    for line in Path("/proc/self/smaps").read_text(errors="replace").splitlines():
        if " kB" not in line and "-" in line.split(" ", 1)[0]:
            code = _CODE.match(line)
            here = (int(code[1], 16), int(code[2], 16)) if code else None
        elif here is not None and line.split() == ["Private_Dirty:", "0", "kB"]:
            yield here
