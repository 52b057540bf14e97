"""Memory that a training step frees stays with the process until the training ends.

Left alone, the C library gives the end of its heap back to the system whenever a step has freed some, and the next step is handed the same
memory anew, zeroed page by page (docs/decisions/0073).
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of mallopt: free bytes at the end of the heap that are given back; sizes mapped on their own
LARGEST_MAPPED = 32 << 20  # the most that glibc takes for the second, and where its own adjustment of both ends
NEVER = (1 << 31) - 1


@contextmanager
def kept_heap() -> Iterator[None]:
    """Give no freed memory back to the system in this block, and all of it after. Elsewhere than with glibc nothing is done."""
    if sys.platform != "linux" or not hasattr(library := ctypes.CDLL(None), "malloc_trim"):
        yield
        return
    library.mallopt(M_MMAP_THRESHOLD, LARGEST_MAPPED)
    library.mallopt(M_TRIM_THRESHOLD, NEVER)
    try:
        yield
    finally:
        library.mallopt(M_TRIM_THRESHOLD, 2 * LARGEST_MAPPED)
        library.malloc_trim(0)
