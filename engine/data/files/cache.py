"""The arrays used last, as many as fit."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable

import numpy as np


class ArrayCache:
    """Least-recently-used arrays up to `limit` bytes. Safe to use from several threads; who asks gets a copy of their own.

    Parameters
    ----------
    limit : int
        Bytes. One array larger than that is handed through and not kept.
    """

    def __init__(self, limit: int = 256 * 2**20):
        self.limit = limit
        self.bytes = 0
        self._arrays: OrderedDict[Hashable, np.ndarray] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: Hashable, load: Callable[[], np.ndarray]) -> np.ndarray:
        """A copy of the array kept under `key`; `load()` is called (outside the lock) when there is none."""
        with self._lock:
            if key in self._arrays:
                self._arrays.move_to_end(key)
                return self._arrays[key].copy()
        array = load()
        with self._lock:
            if key not in self._arrays and array.nbytes <= self.limit:
                self._arrays[key] = array.copy()
                self.bytes += array.nbytes
                while self.bytes > self.limit:
                    self.bytes -= self._arrays.popitem(last=False)[1].nbytes
        return array
