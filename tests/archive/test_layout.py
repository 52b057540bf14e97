"""How columns are written: what is read is what was written, and no two columns have one number."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.archive.index_file import open_index
from degense.engine.archive.layout import FORMATS, OF_FRAMES, column_numbers, packed, unpacked
from degense.engine.archive.search import FRAMES_AT_ONCE, search
from tests.archive import made


@pytest.mark.parametrize("largest", [0, 1, 255, 256, 65_535, 65_536, 2**32 - 1])
@pytest.mark.parametrize("length", [1, 7, 8, 9, 100])
def test_what_is_read_is_what_was_written(largest, length):
    random = np.random.default_rng(length)
    for kind, (scalar, axes) in FORMATS.items():
        if scalar[1:2] == "u":
            values = random.integers(0, min(largest, np.iinfo(scalar).max), (length, *axes), np.uint64, endpoint=True).astype(scalar)
            values[-1] = min(largest, np.iinfo(scalar).max)
        else:
            values = (random.random((length, *axes)) < 0.5) if scalar == "?" else random.normal(size=(length, *axes)).astype(scalar)
        read = unpacked(kind, packed((kind, "liver"), values), length)
        assert read.shape == values.shape
        assert (read == values).all()
        with pytest.raises(ValueError, match="rows of a column"):
            unpacked(kind, bytes(9 * length + 1), length)


def test_every_column_of_every_run_has_a_number_of_its_own():
    run = made.observed(made.film(1))
    assert len({key[0] for key in run.columns}) == len(FORMATS) - 2  # all but confidence and displacement
    assert {"sizes"} <= {*FORMATS} - {*OF_FRAMES}
    numbers = column_numbers(range(1, 4), run.things, run.columns)
    assert len({*numbers}) == 3 * len(run.columns)
    of_run = len(run.columns)
    assert max(numbers[:of_run]) < min(numbers[of_run:])  # so that a new run is written at the end


def test_runs_that_are_not_asked_together_answer_as_together(tmp_path, monkeypatch):
    path = made.archive(tmp_path, **{f"run-{number}": made.observed(made.film(number)) for number in range(5)})

    def answers() -> list:
        texts = (
            "hook left of liver",
            "first grasper near fat",
            "liver after hook near fat",
            "liver while no grasper",
            "fat at its smallest",
        )
        with open_index(path) as index:
            return [[(hit.run.path, hit.answering, [*hit.moments]) for hit in search(index, text).hits] for text in texts]

    assert FRAMES_AT_ONCE > 5 * made.FRAMES
    together = answers()
    assert all(len(hits) > 1 for hits in together)
    monkeypatch.setattr("degense.engine.archive.search.FRAMES_AT_ONCE", 2 * made.FRAMES)
    assert answers() == together
