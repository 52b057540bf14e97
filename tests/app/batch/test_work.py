"""One job: what is done, what is not done again, and what becomes of it when something is missing."""

from __future__ import annotations

import errno
import json
import resource
from dataclasses import replace

import pytest

from degense.app.batch import folder as batch_folder
from degense.app.batch import work
from degense.app.batch.folder import BatchFolder
from degense.app.batch.report import rows_of, write_report
from degense.app.batch.work import do_job
from degense.app.features.runs.run_summaries import summary
from degense.engine.errors import Cancelled, DegenseError
from degense.engine.store import Run
from tests.app.batch.conftest import do, model


def test_stages_are_done_once_and_anew_where_something_else_is_asked(trained, make_job):
    wanted = make_job(prompts=("liver",), exports=("ply", "masks-png"), scores=True)
    [job] = trained.begin([wanted])
    before = model(trained)
    assert do(trained, job) == ["eval", "query", "export ply", "export masks-png"]
    assert do(trained, job) == []
    assert (trained.path / "exports" / "masks-png" / "a" / "labels" / "000004.png").is_file()
    assert summary(trained.run(job)).psnr > 5
    [job] = trained.begin([replace(wanted, prompts=("gallbladder", "liver"))])
    assert do(trained, job) == ["query", "export ply", "export masks-png"]
    assert json.loads((trained.path / "exports" / "masks-png" / "a" / "classes.json").read_text())["classes"][0] == "gallbladder"
    trained.product(job, "eval").unlink()
    assert do(trained, job) == ["eval"]
    assert not [path for path in trained.path.rglob("*") if "draft" in path.name]
    [row] = rows_of(trained, [job])
    assert (row["state"], row["exports"], row["failure"]) == ("done", ["exports/ply/a.ply", "exports/masks-png/a"], "")
    assert [answer["question"] for answer in row["answers"]] == ["gallbladder", "liver"]
    text = write_report(trained, [job])[-1].read_text()
    assert "1 of 1 jobs are done" in text
    assert "| a | liver |" in text
    assert model(trained) == before


def test_a_run_that_was_trained_otherwise_is_not_touched(trained, make_job):
    with pytest.raises(DegenseError, match=r"was trained with another iterations; name the job otherwise"):
        trained.begin([make_job(iterations=90)])
    assert trained.begin([make_job(device="auto")])  # where it is computed may change
    (trained.path / "jobs" / "a.json").unlink()
    log = (trained.path / "runs" / "a" / "metrics.jsonl").read_text()
    assert trained.left(trained.jobs()[0]) == ["train"]  # without its record it is looked at again …
    assert do(trained, trained.jobs()[0]) == ["train"]  # … and found finished
    assert (trained.path / "runs" / "a" / "metrics.jsonl").read_text() == log


def test_stopped_and_resumed_to_the_same_bits(trained_once, make_job, tmp_path, one_thread, monkeypatch):
    monkeypatch.setattr(work, "TELL_SECONDS", 0.0)
    folder = BatchFolder(tmp_path / "out")
    [job] = folder.begin([make_job()])
    seen: list[str] = []
    with pytest.raises(Cancelled):
        do_job(folder, job, lambda stage, fraction, words: seen.append(words), lambda: any(" of " in words for words in seen))
    assert Run.open(folder.run(job)).info["state"] == "stopped"
    assert rows_of(folder, [job])[0]["state"] == "begun"
    with pytest.raises(DegenseError, match="was trained with another seed"):
        folder.begin([make_job(seed=4)])
    assert do(folder, job) == ["train"]
    assert model(folder) == model(trained_once)


def test_what_was_killed_before_its_first_file_begins_anew(trained_once, make_job, tmp_path, one_thread):
    folder = BatchFolder(tmp_path / "out")
    [job] = folder.begin([make_job()])
    (folder.run(job) / "checkpoints").mkdir(parents=True)
    (folder.run(job) / ".run-x.json").touch()
    do(folder, job)
    assert model(folder) == model(trained_once)


def test_a_broken_clip_says_why_and_is_tried_again(make_job, small_clip, tmp_path, trained):
    folder = BatchFolder(tmp_path / "other")
    [job] = folder.begin([make_job(clip=tmp_path / "soon")])
    with pytest.raises(DegenseError, match="soon does not exist"):
        do(folder, job)
    assert "soon does not exist" in folder.record(job).failure
    assert rows_of(folder, [job])[0]["state"] == "failed"


def test_a_full_disk_says_so_and_loses_nothing(trained, make_job):
    [job] = trained.begin([make_job(exports=("ply",), scores=True)])
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        with pytest.raises(DegenseError, match=r"scores.json cannot be written: File too large"):
            do(trained, job)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert trained.left(job) == ["eval", "export ply"]
    assert do(trained, job) == ["eval", "export ply"]
    assert trained.record(job).failure == ""


def test_no_space_for_the_log_of_a_training_is_a_sentence(make_job, tmp_path, monkeypatch):
    folder = BatchFolder(tmp_path / "out")
    [job] = folder.begin([make_job()])

    def full(run, values):
        raise OSError(errno.ENOSPC, "No space left on device", str(run.path / "metrics.jsonl"))

    monkeypatch.setattr(Run, "log", full)
    with pytest.raises(DegenseError, match=r"metrics.jsonl cannot be read or written: No space left on device\."):
        do(folder, job)


def test_nobody_works_on_a_job_twice(trained, make_job, monkeypatch):
    monkeypatch.setattr(batch_folder, "PATIENCE", 0.1)
    [job] = trained.begin([make_job(exports=("ply",))])
    with trained.hold(job), pytest.raises(DegenseError, match="is being done by another process"):
        do(trained, job)
    assert do(trained, job) == ["export ply"]


def test_links_do_not_lead_out_of_the_folder(trained, make_job, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (trained.path / "exports").mkdir()
    (trained.path / "exports" / "ply").symlink_to(tmp_path / "elsewhere")
    [job] = trained.begin([make_job(exports=("ply",))])
    with pytest.raises(DegenseError, match="leads out of the folder"):
        do(trained, job)
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_folder_of_something_else_is_refused(make_job, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "holiday.jpg").touch()
    with pytest.raises(DegenseError, match="is not empty and holds no batch"):
        BatchFolder(tmp_path / "out").begin([make_job()])
    with pytest.raises(DegenseError, match="holds no batch to go on with"):
        BatchFolder(tmp_path).jobs()
    (tmp_path / "batch.json").write_text('{"format": 1, "jobs": [{"name": "../../a"}]}')
    with pytest.raises(DegenseError, match="cannot be read"):
        BatchFolder(tmp_path).jobs()
