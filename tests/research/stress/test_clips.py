"""Clips that nobody wants train and are scored, or are refused in one sentence."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from degense.engine.data.files.depth import read_depth
from degense.engine.data.readers import ClipOptions, open_clip
from degense.engine.errors import ClipError
from degense.engine.research.stress.clip_cases import ClipCase, clip_cases
from degense.engine.research.stress.clips import clip_finding
from degense.engine.research.stress.long import difference, resumed_finding, trained, twice_finding
from degense.engine.research.stress.outcome import sound
from degense.engine.training import TrainConfig
from degense.engine.training.frames import FARTHEST, TrainingFrames
from tests.fakes import MemoryClip

CASES = {case.name: case for case in clip_cases()}
#: These go through readers, flow, training and scores at once; the rest of the bench's clips differ from one of them in one part only.
TRAINED = (
    "1 frame",
    "black frames",
    "one colour",
    "no depth files, black frames",
    "first frame masked whole",
    "held-out frames masked whole",
    "moving mask",
    "one class",
    "classes that no frame shows",
    "NaN, infinite and negative pixels in depth",
    "a few pixels of depth 1e30",
)
REFUSED = ("training frames masked whole", "labels that say nothing", "depth unknown everywhere")


@pytest.mark.parametrize("name", [*TRAINED, *REFUSED])
def test_hostile_clips(tmp_path, name):
    finding = clip_finding(CASES[name], tmp_path, "cpu", 8)
    assert sound(vars(finding)), finding
    assert finding.outcome.startswith("refused: ") == (name in REFUSED)
    assert "\n" not in finding.outcome


def test_a_clip_with_one_valid_pixel_is_refused(tmp_path):
    finding = clip_finding(CASES["all but one pixel masked"], tmp_path, "cpu", 8)
    assert finding.outcome.startswith("refused: ")


def opened(tmp_path, name):
    return open_clip(CASES[name].make(tmp_path / "clip"), ClipOptions(mask_means="tool"))


def test_the_unit_comes_from_the_first_frame_that_shows_depth(tmp_path):
    clip = opened(tmp_path, "first frame masked whole")
    frames = TrainingFrames(clip, 1 << 20, torch.device("cpu"))
    assert not clip.valid(0).any()
    assert frames.unit * float(np.median(clip.depth(2)[clip.valid(2)])) == pytest.approx(1)  # frame 1 is held out


def test_absurd_depths_are_unknown_to_training():
    class Spiked(MemoryClip):
        def depth(self, index):
            depth = super().depth(index)
            depth[0, :3] = 1e30, 2.1 * FARTHEST, 1e-6
            depth[0, 3] = 1.9 * FARTHEST
            return depth

    depth = TrainingFrames(Spiked(), 1 << 20, torch.device("cpu")).depth(0)
    assert np.array_equal(depth[0, :4] > 0, [False, False, False, True])
    assert (depth[1:] > 0).all()


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_depth_files_with_anything_in_them(tmp_path, kind):
    values = np.array([[np.nan, np.inf, -np.inf, -1.0], [0.0, -0.0, 2.5, 7.0]], kind)
    np.save(tmp_path / "depth.npy", values)
    assert np.array_equal(read_depth(tmp_path / "depth.npy", (4, 2)), [[0, 0, 0, 0], [0, 0, 2.5, 7]])
    np.save(tmp_path / "extreme.npy", np.array([[1e300, -1e300, 1e-300, 1e-40]]))
    assert not read_depth(tmp_path / "extreme.npy", (4, 1)).any()


def test_the_same_seed_is_the_same_run(tmp_path):
    finding = twice_finding(tmp_path, (320, 256), "cpu")
    assert finding.outcome == "ok"
    assert finding.error == 0
    config = TrainConfig.preset_of("quick", iterations=20, max_gaussians=400, resolution=8, channels=8, device="cpu", seed=1)
    other = trained(tmp_path, tmp_path / "other", config)
    one = trained(tmp_path, tmp_path / "again", TrainConfig.from_json(config.to_json() | {"seed": 2}))
    assert difference(one, other, "cpu").outcome != "ok"


def test_stopped_and_resumed_is_the_run_that_was_not_stopped(tmp_path):
    """On a clip from disk, across a densification."""
    finding = resumed_finding(tmp_path, "cpu", steps=150)
    assert finding.outcome == "ok"
    assert finding.error == 0


def test_a_case_that_should_be_refused_and_is_not_is_a_fault(tmp_path):
    must = ClipCase("sound", lambda folder: None, refused=True, frames=2)
    assert clip_finding(must, tmp_path / "a", "cpu", 2).outcome.startswith("TRAINED")

    def broken(folder):
        raise ClipError(f"{folder} is broken")

    assert clip_finding(ClipCase("sound", broken), tmp_path / "b", "cpu", 2).outcome == "REFUSED: …/clip is broken"
