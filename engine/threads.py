"""How numba kernels use all cores beside torch's threads and a window's.

Numba's own thread pools do not suit a program that draws from several Python threads: `workqueue` aborts the process when two threads enter
it, `omp` waits by spinning, which on a busy machine costs whole time slices. Hot kernels are therefore shared out by `run_kernel`; kernels
written with numba's `parallel=True` use `workqueue` and take turns behind `KERNEL_LOCK`.

What Python does frame by frame uses another core where what the next frames need is `made_ahead`.

Numba's cache of compiled kernels is written without being synced: what a power cut left of it is compiled anew. Where it can be written
nowhere, kernels are compiled at every start. Files with kernels import this one, so that both holds for them.
"""

from __future__ import annotations

import logging
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

import numba
import numpy as np
import torch
from llvmlite import ir
from numba import types
from numba.core.caching import IndexDataCacheFile
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

from degense.engine.profile import part

numba.config.THREADING_LAYER = "workqueue"
KERNEL_LOCK = threading.RLock()
AHEAD = 2  # items that are made ahead by each thread
Item = TypeVar("Item")
Made = TypeVar("Made")
log = logging.getLogger(__name__)

_load_index, _load_data = IndexDataCacheFile._load_index, IndexDataCacheFile._load_data


def _index_or_nothing(cache: IndexDataCacheFile) -> dict[Any, str]:
    """What a file of the cache holds; nothing where it is damaged, which numba itself raises, at every start."""
    try:
        return _load_index(cache)
    except Exception as error:  # whatever the loader meets in bytes that are none
        log.warning("the compiled kernels in %s are damaged (%r) and made anew", cache._index_path, error)
        return {}


def _data_or_nothing(cache: IndexDataCacheFile, name: str) -> Any:
    try:
        return _load_data(cache, name)
    except OSError:
        raise
    except Exception as error:
        raise OSError(f"the compiled kernel {name} is damaged ({error!r})") from error  # numba takes it for a file that is gone


IndexDataCacheFile._load_index, IndexDataCacheFile._load_data = _index_or_nothing, _data_or_nothing

_enable_caching = Dispatcher.enable_caching


@cache
def _say_once() -> None:
    log.warning("Compiled kernels can be kept nowhere, so that every start takes a minute; name a folder for them in NUMBA_CACHE_DIR.")


def _cached_where_possible(kernel: Dispatcher) -> None:
    """Keep a kernel where numba finds a folder that can be written; numba itself ends the program where it finds none."""
    try:
        _enable_caching(kernel)
    except RuntimeError:
        _say_once()


Dispatcher.enable_caching = _cached_where_possible

_HELPERS = ThreadPoolExecutor(max_workers=os.cpu_count() or 1, thread_name_prefix="kernel")


_OWN = threading.local()


def kernel_threads() -> int:
    """Threads that a kernel uses that is called here: as many as torch, but for `one_torch_thread`."""
    return getattr(_OWN, "kernel_threads", 0) or torch.get_num_threads()


@contextmanager
def one_torch_thread(kernels: int = 0) -> Iterator[None]:
    """Let torch's operations run on the thread that calls them, in this thread and in those that are made meanwhile.

    Kernels that this thread calls use `kernels` threads, or as many as before.

    For many small operations: torch's threads meet after each, spinning. On a busy machine every such meeting costs a time slice, and the
    kernels in between have no core for their helpers.
    """
    torch_threads, before = torch.get_num_threads(), getattr(_OWN, "kernel_threads", 0)
    _OWN.kernel_threads = kernels or kernel_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        _OWN.kernel_threads = before
        torch.set_num_threads(torch_threads)


@contextmanager
def many_torch_threads() -> Iterator[None]:
    """Within `one_torch_thread`, let torch's operations run on as many threads as kernels do: for large operations one after the other."""
    before = torch.get_num_threads()
    torch.set_num_threads(kernel_threads())
    try:
        yield
    finally:
        torch.set_num_threads(before)


def run_kernel(kernel: Callable[..., None], *arguments) -> None:
    """Call `kernel(*arguments, counter)` on `kernel_threads()` threads and return when all work is done.

    The caller and a few helper threads run the same nogil kernel, and each takes work by drawing tickets from a shared counter. Nobody
    waits for a helper that has not begun: on a busy machine the caller simply does more itself. Any number of threads may call at once.

    `counter`, int64 [1], starts at zero; the kernel draws from it with `take_ticket` until there is no work left.
    """
    counter = np.zeros(1, np.int64)
    with part(f"kernel {kernel.__module__.rpartition('.')[2]}.{kernel.__name__.strip('_')}"):
        helpers = [_HELPERS.submit(kernel, *arguments, counter) for _ in range(kernel_threads() - 1)]
        kernel(*arguments, counter)
        for helper in helpers:
            if not helper.cancel():
                helper.result()


@contextmanager
def abandonable_pool(threads: int, name: str = "") -> Iterator[ThreadPoolExecutor]:
    """Threads for a generator: at its end what has not begun is dropped, and what goes on is not waited for.

    A generator that nobody asks any more is closed by the garbage collector, in whatever thread that runs. One that is just being started
    holds a lock of `threading` that waiting for another thread takes too, so that both would wait for ever.
    """
    pool = ThreadPoolExecutor(threads, name)
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def made_ahead(make: Callable[[Item], Made], items: Sequence[Item], threads: int = 1) -> Iterator[Made]:
    """What is made of items on so many threads, in order, while what was made of those before is used; a single thread takes one after the
    other."""
    with abandonable_pool(threads) as makers:
        made = deque(makers.submit(make, item) for item in items[: AHEAD * threads])
        for item in items[AHEAD * threads :]:
            yield made.popleft().result()
            made.append(makers.submit(make, item))
        while made:
            yield made.popleft().result()


@intrinsic
def take_ticket(typing, counter):
    """The next number of a shared int64 counter [1]: how threads share out work of uneven size."""

    def codegen(context, builder, signature, values):
        pointer = context.make_array(signature.args[0])(context, builder, values[0]).data
        return builder.atomic_rmw("add", pointer, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), codegen
