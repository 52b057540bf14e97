"""Running one kernel on all cores.

Numba's own thread pools do not suit a window that draws from several Python threads beside torch: `workqueue` aborts the process
when two threads enter it, `omp` waits by spinning, which on a busy machine costs whole time slices. Here the caller and a few
helper threads run the same nogil kernel, and each takes work by drawing tickets from a shared counter. Nobody waits for a helper
that has not begun: on a busy machine the caller simply does more itself. Any number of threads may call at once.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch

_HELPERS = ThreadPoolExecutor(max_workers=os.cpu_count() or 1, thread_name_prefix="raster")


def run_kernel(kernel: Callable[..., None], *arguments) -> None:
    """Call `kernel(*arguments, counter)` on `torch.get_num_threads()` threads and return when all work is done.

    `counter`, int64 [1], starts at zero; the kernel draws from it with `take_ticket` until there is no work left.
    """
    counter = np.zeros(1, np.int64)
    helpers = [_HELPERS.submit(kernel, *arguments, counter) for _ in range(torch.get_num_threads() - 1)]
    kernel(*arguments, counter)
    for helper in helpers:
        if not helper.cancel():
            helper.result()
