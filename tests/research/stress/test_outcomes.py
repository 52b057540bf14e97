"""The bench's own judgement: what passes, what does not, and that memory is measured."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from degense.engine.data.readers import open_clip
from degense.engine.errors import ClipError
from degense.engine.research.bench.child import call_in_child, peak_memory
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.stress import features, long_clips
from degense.engine.research.stress.long import difference
from degense.engine.research.stress.outcome import StressFinding, non_finite, row, sound, verdict


def fail(error):
    raise error


def test_a_row_says_what_became_of_a_case():
    assert sound(row("fine", StressFinding))
    assert not sound(row("numbers", lambda: StressFinding(bad=2)))
    refused = row("refused", lambda: fail(ClipError("/where/clip is empty")), "/where")
    assert sound(refused)
    assert refused["outcome"] == "refused: …/clip is empty"
    crashed = row("crashed", lambda: fail(IndexError("5")))
    assert not sound(crashed)
    assert crashed["outcome"] == "CRASHED: IndexError: 5"


def test_only_finite_numbers_count_as_finite():
    values = {"a": [1.0, float("nan")], "b": torch.tensor([0.0, torch.inf]), "c": np.array([np.nan, 1]), "d": None, "e": "nan", "f": 3}
    assert non_finite(values) == 3


def test_nan_errors_exceed_every_tolerance():
    assert verdict(image=(0.0, 0.1), gradient=(0.1, 0.1)) == "ok"
    assert verdict(image=(float("nan"), 0.1)) == "IMAGE BEYOND TOLERANCE"
    assert verdict(image=(0.2, 0.1), gradient=(1.0, 0.1)) == "IMAGE AND GRADIENT BEYOND TOLERANCE"


def grown(megabytes):
    before = peak_memory()
    np.ones(megabytes << 17).sum()
    return before, peak_memory()


def test_memory_is_that_of_the_work():
    before, after = call_in_child(grown, 200)
    if before is not None:  # Linux
        assert 150 < after - before < 260
        assert before < 1024


def test_models_that_differ_by_a_bit_are_not_the_same_run():
    one = {"a": torch.ones(3), "b": torch.zeros(0)}
    two = {"a": torch.tensor([1.0, 1.0, 1.0 + 2**-23]), "b": torch.zeros(0)}
    assert difference(one, one, "cpu").outcome == "ok"
    assert difference(one, two, "cpu").outcome == "NOT THE SAME RUN"
    assert difference(one, {"a": torch.ones(4), "b": torch.zeros(0)}, "cpu").outcome == "ANOTHER NUMBER OF GAUSSIANS"


@pytest.mark.parametrize("kind", ["pictures", "video"])
def test_long_clips_open(tmp_path, kind):
    frames = 2 * long_clips.PICTURES + 1
    if kind == "pictures":
        long_clips.write_pictures(tmp_path / "clip", frames, 48, 32)
        clip = open_clip(tmp_path / "clip")
        assert np.array_equal(clip.frame(0), clip.frame(2 * long_clips.PICTURES))
        assert clip.depth_measured
        assert len(clip.labelled_frames) == frames
        assert not clip.valid(1).all()
    else:
        long_clips.write_video(tmp_path / "clip.mp4", frames, 48, 32)
        clip = open_clip(tmp_path / "clip.mp4")
    assert len(clip) == frames
    assert not np.array_equal(clip.frame(0), clip.frame(10))


def test_the_table_of_features(tmp_path):
    table = features.table(BenchOptions("cpu", (0,), 1, True, tmp_path))
    table.markdown()
    assert not {row["case"] for row in table.rows if not sound(row)}
    assert not list(tmp_path.iterdir())
