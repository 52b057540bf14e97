"""Scores of a tiny real run: the promised keys, the protocol, clips that lack things or do not fit."""

import dataclasses
import json

import numpy as np
import pytest

from degense.engine.errors import ClipError
from degense.engine.metrics.evaluate import evaluate
from degense.engine.metrics.masks import MaskScores
from degense.engine.metrics.semantics import closed_set
from degense.engine.semantics.prompts import DECODERS
from tests.fakes import MemoryClip

#: What `degense eval --json` promises to outside scripts.
ALWAYS = {"psnr_mask", "psnr_masked_product", "psnr_full", "ssim", "lpips", "train_seconds", "gaussians", "render_fps", "query_ms"}
WITH_TRUTH = {"miou", "displacement_error", "displacement_correlation", "spurious_displacement"}


@pytest.fixture(scope="module")
def scores(scene, clip):
    return evaluate(scene, clip)


def without(clip, **answers):
    """The clip, some of whose methods answer otherwise."""

    class Changed(type(clip)):
        pass

    for name, answer in answers.items():
        setattr(Changed, name, answer)
    copy = dataclasses.replace(clip)
    copy.__class__ = Changed
    return copy


def test_every_promised_key_is_there_and_can_be_written(scores):
    assert set(scores) >= ALWAYS | WITH_TRUTH
    assert json.loads(json.dumps(scores)) == scores
    for name in (ALWAYS | WITH_TRUTH) - {"lpips", "miou"}:
        assert np.isfinite(scores[name]), name
    assert set(scores["miou"]) == set(DECODERS)
    assert all(0 <= value <= 1 for value in scores["miou"].values())
    assert set(scores["miou_closed"]) == set(scores["masks_closed"]) == {"argmax", "rnse+argmax"}
    assert scores["confidence"]["masks"] > 0
    assert 0 < scores["inspection"]["wrong"] < scores["inspection"]["average_precision"] < 1
    for name in ("render_fps", "query_ms", "query_new_frame_ms", "train_seconds"):
        assert scores[name] > 0


def test_numbers_are_those_of_the_run(scores, scene, clip):
    assert scores["gaussians"] == len(scene.model)
    assert scores["train_seconds"] == scene.run.info["train_seconds"]
    assert (scores["run"], scores["clip"], scores["unit"]) == ("run", "clip", "mm")
    assert (scores["routing"], scores["preset"]) == ("isolated", "quick")
    assert scores["frames"] == clip.test_frames == [1]
    error = (scene.render_rgb(1).astype(np.float64) - clip.frame(1)) / 255
    assert scores["psnr_mask"] == pytest.approx(10 * np.log10(1 / np.mean(error**2)), abs=1e-6)
    truth = clip.truth()
    wrong, moved = [], []
    for i in range(len(clip)):
        predicted, right = scene.render(i, None, ("displacement",))["displacement"], np.linalg.norm(truth.displacement[i], axis=-1)
        known = np.isfinite(predicted) & np.isfinite(right)
        wrong.append(np.abs(predicted - right)[known])
        moved.append(np.stack([predicted[known], right[known]]))
    assert scores["displacement_error"] == pytest.approx(np.concatenate(wrong).mean(), rel=1e-4)
    assert scores["displacement_correlation"] == pytest.approx(np.corrcoef(np.concatenate(moved, 1))[0, 1], abs=1e-4)


def test_guesses_are_scored_both_ways_and_by_the_observability_beside_them(scores, clip):
    depth = clip.depth(0)
    assert scores["displacement_scale"] == pytest.approx(np.median(depth[depth > 0]))
    for name in ("displacement_error", "displacement_correlation", "recovered_share", "false_motion", "displacement_coverage"):
        assert np.isfinite(scores[name]), name
        assert f"{name}_revealed" in scores
    assert scores["displacement_coverage_revealed"] < scores["displacement_coverage"]
    bins = scores["displacement_error_by_observability"]
    assert sum(found["share"] for found in bins.values()) == pytest.approx(1)
    assert scores["displacement_error_uncertain"] > scores["displacement_error_revealed"]


def test_closed_set_maps_give_every_drawn_pixel_its_likeliest_class():
    maps = np.array([[[0.2, 0.0, -0.1, 0.3]], [[0.1, 0.0, -0.3, 0.4]]], np.float32)
    assert closed_set(list(maps)).tolist() == [[0, 255, 0, 1]]


def test_closed_set_scores_are_those_of_the_maps(scores, scene, clip):
    vectors, by_hand = scene.vectors(clip.classes), MaskScores(clip.classes, ("background",))
    maps = np.stack([scene.query(1).refined(vector) for vector in vectors])
    by_hand.add(np.where((maps != 0).any(0), maps.argmax(0), 255).astype(np.uint8), clip.labels(1), clip.valid(1))
    assert scores["miou_closed"]["rnse+argmax"] == pytest.approx(by_hand.result()["miou"])


def test_pictures_and_masks_come_from_held_out_frames_only(scene, clip, monkeypatch):
    for part in ("score_flicker", "_score_inspection"):  # need the frame before, and all frames
        monkeypatch.setattr(f"degense.engine.metrics.evaluate.{part}", lambda scene, clip, frames, progress: {})
    asked = {"frame": [], "labels": []}

    def watch(name):
        real = getattr(type(clip), name)

        def method(self, index):
            asked[name].append(index)
            return real(self, index)

        return method

    result = evaluate(scene, without(clip, frame=watch("frame"), labels=watch("labels")))
    assert asked["frame"] == clip.test_frames
    assert set(asked["labels"]) == set(clip.test_frames)
    assert result["held_out"] is True
    assert result["mask_frames"] == clip.test_frames
    assert result["mask_frames_trained"] == []


def test_calibration_and_flicker_are_those_of_the_runs_masks(scores, scene, clip):
    """The default threshold scores what prompts get; flicker is looked for between the held-out frame and the one before it."""
    vectors, truth, by_hand = scene.vectors(clip.classes), clip.labels(1), MaskScores(clip.classes)
    for index in range(len(clip.classes)):
        by_hand.add_mask(index, scene.query(1).similarity(vectors[index]) > 0.5, truth, clip.valid(1))
    assert scores["calibration"]["threshold"]["miou_default"] == pytest.approx(by_hand.result()["miou"])
    assert scores["calibration"]["rnse"]["miou_best"] >= scores["calibration"]["rnse"]["miou_default"]
    assert scores["flicker_pairs"] == 1
    assert all(0 <= scores["flicker"][decoder] < 0.2 for decoder in DECODERS)


def test_a_clip_whose_labels_were_all_trained_on_says_so(scene, clip):
    result = evaluate(scene, without(clip, labelled_frames=property(lambda self: [4])))
    assert result["mask_frames"] == [4]
    assert result["mask_frames_trained"] == [4]


def test_nothing_is_scored_without_an_answer(scene, speechless, clip):
    bare = without(clip, labelled_frames=property(lambda self: []), labels=lambda self, index: None, truth=lambda self: None)
    result = evaluate(scene, bare)
    assert set(result) >= ALWAYS
    assert not set(result) & (WITH_TRUTH | {"masks"})
    mute = evaluate(speechless, clip)
    assert set(mute) >= ALWAYS | WITH_TRUTH - {"miou"}
    assert mute["query_ms"] is None
    assert not set(mute) & {"miou", "masks"}


def test_a_run_whose_recording_is_missing_is_inspected_by_the_clip_it_is_scored_on(scores, scene, clip, monkeypatch):
    monkeypatch.setattr(scene, "clip", None)
    scene.__dict__.pop("observed_motion", None)
    assert evaluate(scene, clip, parts=("inspection",))["inspection"] == scores["inspection"]


@pytest.mark.parametrize(("frames", "width"), [(9, 48), (8, 64)])
def test_another_clip_is_refused_in_one_sentence(scene, frames, width):
    with pytest.raises(ClipError, match=rf"{frames} frames of \({width}, 48\), but run was trained on 9 of \(64, 48\)") as caught:
        evaluate(scene, MemoryClip(frames, width, 48))
    assert "\n" not in str(caught.value)


def test_progress_never_goes_back(scene, clip):
    told = []
    evaluate(scene, clip, lambda fraction, message: told.append((fraction, message)))
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] <= 1
    assert {"comparing pictures", "comparing masks", "measuring flicker", "comparing motion", "inspecting motion", "measuring speed"} == {
        message for _, message in told
    }
