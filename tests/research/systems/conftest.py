"""Trainings of a few steps on a few pixels: more than one thread would only wait for another, on a busy machine for long."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from degense.engine.research.bench.timing import threads


@pytest.fixture(autouse=True, scope="package")
def one_thread() -> Iterator[None]:
    with threads(1):
        yield
