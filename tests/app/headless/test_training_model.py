"""Queue of trainings, their settings and their words, without a window."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from degense.app.features.runs.run_summaries import list_runs, training_answers
from degense.app.features.train.job import TrainingJob, parse_settings
from degense.app.features.train.queue import TrainingQueue
from degense.app.features.train.settings_help import TEACHER_WORDS, settings_of
from degense.engine.errors import DegenseError
from degense.engine.semantics.teachers import MAKERS
from degense.engine.training import TrainConfig
from degense.engine.training.config import GROUPS

JOB = TrainingJob(Path("clip"), Path("run"))


def test_one_at_a_time_and_nobody_overtakes_who_is_paused(tmp_path):
    queue = TrainingQueue()
    first, second, third = (replace(JOB, out=tmp_path / name) for name in ("a", "b", "c"))
    for job in (first, second, third):
        queue.add(job)
    assert queue.next() == first
    assert queue.next() is None
    queue.raise_(1)
    assert queue.waiting == (third, second)
    with pytest.raises(DegenseError, match="queue already"):
        queue.add(replace(first, preset="best"))
    queue.ended(first, paused=True)
    assert queue.next() is None
    first.out.mkdir()
    (first.out / "run.json").touch()
    queue.resume()
    assert queue.next() == replace(first, resume=True)
    queue.ended(queue.running[0], paused=True)
    queue.forget_paused()
    assert queue.next() is None  # the next waits for somebody to go on
    assert queue.jobs == (third, second)  # third has no checkpoint yet: it begins anew
    queue.resume()
    assert queue.next() == third
    queue.remove(0)
    queue.ended(third)
    assert queue.next() is None


def test_several_at_a_time_are_paused_and_resumed_together(tmp_path):
    slots = 2
    queue = TrainingQueue(lambda: slots)
    first, second, third = (replace(JOB, out=tmp_path / name) for name in ("a", "b", "c"))
    for job in (first, second, third):
        assert queue.full == (job == third)
        queue.add(job)
    assert [queue.next(), queue.next(), queue.next()] == [first, second, None]
    queue.ended(first, paused=True)
    assert queue.next() is None  # the other is being paused too
    queue.ended(second, paused=True)
    assert (queue.running, queue.paused, queue.jobs) == ((), first, (first, second, third))
    queue.forget_paused()
    assert (queue.paused, queue.waiting) == (second, (third,))
    queue.resume()
    assert [queue.next(), queue.next()] == [second, third]
    slots = 3
    queue.add(first)
    assert queue.next() == first


def test_what_is_not_done_is_kept(tmp_path):
    job = TrainingJob(tmp_path / "clip", tmp_path / "a", "quick", iterations=7, focal=500.0, settings=(("flow", "7"),))
    other = replace(JOB, out=tmp_path / "b")
    queue = TrainingQueue()
    queue.add(job)
    queue.add(other)
    queue.next()
    again = TrainingQueue()
    again.restore([TrainingJob.from_json(data) for data in json.loads(json.dumps([job.to_json() for job in queue.jobs]))])
    assert again.jobs == (job, replace(other, clip=other.clip.resolve()))
    assert again.next() is None
    again.resume()
    assert again.next() == job
    for wrong in ({}, [], {"clip": "a"}, {"clip": "a", "out": "b", "iterations": "7"}, {"clip": "a", "out": "b", "settings": [["x", "1"]]}):
        with pytest.raises(DegenseError, match="cannot be read"):
            TrainingJob.from_json(wrong)
    with pytest.raises(DegenseError, match="cannot be read"):
        TrainingJob.from_json(job.to_json() | {"telepathy": 1})
    old = job.to_json() | {"fit": False, "settings": [["early_stopping", "true"], ["flow", "7"]]}
    assert TrainingJob.from_json(json.loads(json.dumps(old))) == job


def test_settings_are_typed_and_refused_in_words():
    values = parse_settings((("flow", "7"), ("levels", "[1, 2, 4]"), ("appearance", "false"), ("max_rank", "8")))
    assert values == {"flow": 7.0, "levels": (1, 2, 4), "appearance": False, "max_rank": 8}
    for pair in (
        ("flow", "much"),
        ("flow", "-1"),
        ("flow", "NaN"),
        ("levels", "[]"),
        ("max_rank", "2.5"),
        ("appearance", "1"),
        ("nothing", "1"),
    ):
        with pytest.raises(DegenseError, match=pair[0]):
            parse_settings((pair,))
    with pytest.raises(DegenseError, match="iterations"):
        parse_settings((("iterations", "5"),))  # it has an option of its own
    assert parse_settings((("plane_still", "0.1"), ("tint", "0.5"))) == {"plane_static": 0.1, "color_residual": 0.5}


def test_answers_are_reused_and_hostile_ones_left_out():
    job = replace(JOB, preset="quick", seed=4, settings=(("flow", "3"),), poses="still")
    again = JOB.with_answers(json.loads(json.dumps(job.answers())))
    assert again == replace(job, poses=None)
    old = job.answers() | {"fit": True, "settings": [["early_stop", "true"], ["flow", "3"]]}
    assert JOB.with_answers(old) == again
    assert JOB.with_answers({"seed": "x", "preset": 5, "out": "elsewhere", "settings": [["flow", "1", "2"]]}) == JOB
    assert JOB.with_answers({"preset": "of a newer version"}) == JOB


def test_every_setting_has_words_of_its_own():
    changed = settings_of(TrainConfig.preset_of("quick", flow=3.0))
    assert all(len(setting.words) > 10 for setting in changed)
    assert len({setting.words for setting in changed}) == len(changed)
    assert [setting.name for setting in changed if setting.changed] == ["flow"]
    assert [setting.name for setting in changed] == [n for names in GROUPS.values() for n in names if n not in ("preset", "given")]
    assert {"rate_planes", "rate_means"} <= set(GROUPS["Learning rates"])
    assert {*MAKERS, "none"} - set(TEACHER_WORDS) <= {"degraded", "unseen"}  # of experiments, where they have been imported


def test_a_folder_of_runs_with_anything_in_it(tmp_path):
    for name, text in (
        ("bad", "[]"),
        ("worse", "{"),
        ("empty", "{}"),
        ("odd", json.dumps({"state": "finished", "config": 5, "clip": {"name": 7}})),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text(text)
    (tmp_path / "odd" / "metrics.jsonl").write_text('{"iteration": 25, "psnr": 30.5}\n{"iteration": 50, "ps')
    (tmp_path / "odd" / "scores.json").write_text(json.dumps({"psnr_mask": 31, "miou": None}))
    (tmp_path / "no run").mkdir()
    found = {run.name: run for run in list_runs(tmp_path)}
    assert {name: run.state for name, run in found.items()} == {"bad": "damaged", "worse": "damaged", "empty": "damaged", "odd": "finished"}
    assert (found["odd"].iteration, found["odd"].training_psnr, found["odd"].psnr, found["odd"].miou) == (25, 30.5, 31.0, None)
    with pytest.raises(DegenseError, match="cannot be read"):
        list_runs(tmp_path / "nowhere")
    with pytest.raises(DegenseError, match="worse"):
        training_answers(tmp_path / "worse")
