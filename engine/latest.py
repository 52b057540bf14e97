"""What was used last, kept within a bound."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

Value = TypeVar("Value")


class Latest:
    """Values by key, the least recently used forgotten first; safe to use from several threads.

    `limit` bounds their sizes together, bytes or a plain count; the newest value is kept even when it is too large alone.
    """

    def __init__(self, limit: int):
        self.limit, self.size = limit, 0
        self._held: OrderedDict[Hashable, tuple[int, Any]] = OrderedDict()
        self._lock = threading.Lock()

    def __contains__(self, key: Hashable) -> bool:
        return key in self._held

    def get(self, key: Hashable, make: Callable[[], Value], size: Callable[[Value], int] = lambda value: 1) -> Value:
        """The value of `key`, made (outside the lock) if there is none."""
        with self._lock:
            if key in self._held:
                self._held.move_to_end(key)
                return self._held[key][1]
        value = make()
        self.keep(key, value, size(value))
        return value

    def keep(self, key: Hashable, value: Any, size: int = 1) -> None:
        self.forget(key)
        with self._lock:
            self._held[key] = (size, value)
            self.size += size
            while self.size > self.limit and len(self._held) > 1:
                self.size -= self._held.popitem(last=False)[1][0]

    def make_room(self, size: int) -> None:
        """Forget now what a value of this size would push out, so that both need no memory while it is made."""
        with self._lock:
            while self.size + size > self.limit and self._held:
                self.size -= self._held.popitem(last=False)[1][0]

    def forget(self, key: Hashable) -> None:
        with self._lock:
            self.size -= self._held.pop(key, (0, None))[0]
