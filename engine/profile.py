"""Where the time of a training goes: nested parts with names, timed only while a profile is recorded."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

#: Names of a part and of those around it, outermost first.
Path = tuple[str, ...]
MARKS = 4096  # of a GPU's queue that are kept before the times between them are read


@dataclass
class Spent:
    """The time of one part."""

    own: float = 0.0  # seconds, without the parts within it
    calls: int = 0


class Profile:
    """Seconds by part, on the processor's clock or, on `cuda`, between marks in the GPU's queue, so that no part waits for the GPU.

    At each moment one part is running, so the times of all add up to the time that was recorded.
    """

    def __init__(self, device: str):
        self.device = device
        self.spent: dict[Path, Spent] = {(): Spent(calls=1)}
        self._path: Path = ()
        self._thread = threading.get_ident()
        self._marks: list[tuple[Path, Any]] = []
        self._last: Any = self._now()

    @property
    def seconds(self) -> float:
        """All that was recorded."""
        return sum(spent.own for spent in self.spent.values())

    def within(self, path: Path) -> float:
        """Seconds of a part with all parts within it."""
        return sum(spent.own for other, spent in self.spent.items() if other[: len(path)] == path)

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """A block that counts as a part within the running one; one of another thread counts as what it is called in."""
        if threading.get_ident() != self._thread:
            yield
            return
        around = self._path
        self._enter((*around, name))
        try:
            yield
        finally:
            self._turn_to(around)

    def rename(self, name: str) -> None:
        """From now on what runs, as part `name` of what is around the running part."""
        self._enter((*self._path[:-1], name))

    def finish(self) -> None:
        """Count what runs until now."""
        self._turn_to(self._path)
        self._read_marks()

    def _enter(self, path: Path) -> None:
        self._turn_to(path)
        self.spent.setdefault(path, Spent()).calls += 1

    def _turn_to(self, path: Path) -> None:
        now = self._now()
        if self.device == "cuda":
            self._marks.append((self._path, now))
            if len(self._marks) >= MARKS:
                self._read_marks()
        else:
            self.spent[self._path].own += now - self._last
            self._last = now
        self._path = path

    def _now(self) -> Any:
        if self.device != "cuda":
            return time.perf_counter()
        mark = torch.cuda.Event(enable_timing=True)
        mark.record()
        return mark

    def _read_marks(self) -> None:
        """Add up the times between marks, after the GPU has passed the last of them."""
        if not self._marks:
            return
        self._marks[-1][1].synchronize()
        for path, mark in self._marks:
            self.spent[path].own += self._last.elapsed_time(mark) / 1e3
            self._last = mark
        self._marks.clear()


_recorded: Profile | None = None
_NOTHING: AbstractContextManager[None] = nullcontext()


@contextmanager
def recording(device: str) -> Iterator[Profile]:
    """A block of which a profile is recorded, in the thread that runs it; `device` is "cpu" or "cuda"."""
    global _recorded
    _recorded = profile = Profile(device)
    try:
        yield profile
    finally:
        _recorded = None
        profile.finish()


def is_recorded() -> bool:
    """Whether a profile is recorded."""
    return _recorded is not None


def part(name: str) -> AbstractContextManager[None]:
    """A block that is a part of the profile that is recorded, if one is."""
    return _NOTHING if _recorded is None else _recorded.part(name)


def renamed_at_gradient(tensor: Tensor, name: str) -> None:
    """Let what runs count as part `name` from when the gradient of `tensor` is known: backward passes go on from there."""
    if _recorded is not None and tensor.requires_grad:
        rename: Callable[[str], None] = _recorded.rename
        tensor.register_hook(lambda _: rename(name))
