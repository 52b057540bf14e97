"""One labelled frame of a hand-held camera: what entered later is told from what was shown, and answers are scored for it."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.progress import silent
from degense.engine.research.hand_held.scores import ENTERED, NEW, SHOWN, AnswerScores
from degense.engine.research.hand_held.shown import shown_at_first
from degense.engine.research.hand_held.tables import answers, scored, scored_frames, trained
from degense.engine.training import TrainConfig

SURGERY = 84  # its camera drifts far
LAST = 11


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hand-held") / "clip"
    make_phantom(folder, PhantomOptions(LAST + 1, 96, 80, SURGERY, 8.0, kind="family"))
    return folder


@pytest.fixture(scope="module")
def clip(folder):
    return open_clip(folder)


def test_tissue_is_shown_where_its_tracked_points_were_seen(clip):
    truth = clip.truth()
    first = shown_at_first(clip, truth, 0)
    assert np.array_equal(first.shown, first.tissue)
    found = []
    for frame in range(1, LAST + 1):
        shown = shown_at_first(clip, truth, frame).shown
        pixels, _ = clip.cameras[frame].project(truth.tracks[:, frame].astype(float))
        column, row = np.floor(pixels[truth.visible[:, frame]]).astype(int).T
        found.append(shown[row, column][truth.visible[truth.visible[:, frame], 0]])
    assert np.concatenate(found).mean() > 0.99


def test_what_enters_comes_from_the_border(clip):
    kinds = AnswerScores(clip).kinds(LAST)
    assert (kinds == ENTERED).mean() > 0.05
    assert (kinds[20:60, 25:70] == ENTERED).mean() < 0.05


def perfect(clip, scores, frame):
    kinds = scores.kinds(frame)
    return np.where((kinds == ENTERED) | (kinds == NEW), np.uint8(UNLABELLED), clip.labels(frame))


def test_answers_have_the_scores_that_they_deserve(clip):
    scores = AnswerScores(clip)
    for frame in scored_frames(clip):
        scores.add(frame, perfect(clip, scores, frame), np.ones(clip.size[::-1]))
    cells = scores.cells()
    assert (cells["last"], cells["entered"], cells["new"], cells["misnamed"]) == (1.0, 100.0, 100.0, 0.0)
    assert (cells["missed"], cells["error"], cells["both"]) == (0.0, 0.0, 100.0)
    assert 5 < cells["pixels"] < 50 > cells["new_pixels"] > 0
    named = AnswerScores(clip)
    for frame in scored_frames(clip):
        named.add(frame, clip.labels(frame))
    cells = named.cells()
    assert (cells["last"], cells["entered"], cells["new"], cells["misnamed"], cells["error"]) == (1.0, 0.0, 0.0, 0.0, None)
    wrong = AnswerScores(clip)
    wrong.add(LAST, np.where(wrong.kinds(LAST) == SHOWN, np.uint8(UNLABELLED), clip.labels(LAST)), np.ones(clip.size[::-1]))
    assert (wrong.cells()["last"], wrong.cells()["missed"]) == (0.0, 100.0)
    assert wrong.cells()["error"] > 50


def test_a_scene_of_one_labelled_frame_leaves_unlabelled_what_entered(folder, clip):
    config = TrainConfig.preset_of("quick", iterations=120, semantic_steps=20, max_gaussians=1500, device="cpu")
    scene = trained(folder, config, silent)
    found = {name: scored(clip, answer).cells() for name, answer in answers(clip, scene).items()}
    assert scene.run.load_label_support(len(scene.model)).frames == [0]
    assert found["scene, what the first frame shows"]["entered"] > 50 > 10 > found["scene, every pixel may be named"]["entered"]
    assert found["scene"]["misnamed"] < 10
    assert found["scene"]["last"] > found["copied"]["last"] - 0.05
