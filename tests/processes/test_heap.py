"""Memory that is freed while a training runs is not asked for anew."""

import resource
import sys
from pathlib import Path

import numpy as np
import pytest

from degense.engine.processes.heap import kept_heap

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only glibc is told")
MIB = 1 << 20


def use_and_free(rounds: int) -> int:
    """Write to 48 MiB and free them so many times; the pages that the system handed out for it."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(rounds):
        parts = [np.ones(3 * MIB, np.uint8) for _ in range(16)]
        del parts
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def resident() -> int:
    """Bytes of this process that lie in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def test_what_is_freed_is_used_again_and_given_back_in_the_end():
    with kept_heap():
        use_and_free(2)
        assert use_and_free(20) < 2000  # of 245,760 pages
        kept = resident()
    assert resident() < kept - 40 * MIB
