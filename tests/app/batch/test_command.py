"""`degense batch`: what it takes, what it shows, and what it writes for Slurm."""

from __future__ import annotations

import json
import os
import subprocess

import pytest

from degense.app.batch.folder import BatchFolder
from degense.app.batch.progress import BatchProgress
from degense.app.batch.report import markdown, rows_of
from degense.app.batch.slurm import slurm_script
from degense.app.cli.batch import table
from degense.app.cli.batch.table import JsonLines, PlainLines, TerminalTable
from degense.app.cli.main import main
from degense.engine.errors import DegenseError


def run(*words: object) -> int:
    return main(["batch", *map(str, words)])


def test_a_batch_on_the_command_line_is_kept_and_emitted(tmp_path, capsys, small_clip):
    out, script = tmp_path / "a folder", tmp_path / "array.sh"
    said = ["--preset", "quick", "--set", "flow=3", "--prompt", "liver", "--export", "ply", "--no-eval", "--device", "cpu", "--stride", "2"]
    assert run(small_clip, tmp_path / "b.mp4", "--out", out, *said, "--slots", 3, "--emit", "slurm", script) == 0
    jobs = BatchFolder(out).jobs()
    assert [(job.name, job.prompts, job.exports, job.scores, job.training.stride) for job in jobs] == [
        (name, ("liver",), ("ply",), False, 2) for name in ("clip", "b")
    ]
    assert {job.training.config().flow for job in jobs} == {3.0}
    text = script.read_text()
    assert "#SBATCH --array=0-1%3\n" in text
    assert "gres" not in text
    assert subprocess.run(["bash", "-n", script]).returncode == 0
    stub = tmp_path / "degense"
    stub.write_text('#!/bin/bash\nprintf "%s\\n" "$@"\n')
    stub.chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "SLURM_ARRAY_TASK_ID": "1"}
    told = subprocess.run(["bash", script], env=environment, capture_output=True, text=True).stdout.splitlines()
    assert told == ["batch", "--out", str(out), "--share", "1/2", "--slots", "1", "--json"]
    assert "submit it with sbatch" in capsys.readouterr().out


def test_large_batches_and_hostile_folders_in_slurm(tmp_path):
    assert "--array=0-999%7" in slurm_script(tmp_path, 2500, 7, "auto")
    assert "--gres=gpu:1" in slurm_script(tmp_path, 2500, 7, "auto")
    assert f"'{tmp_path}/a; rm -rf b'" in slurm_script(tmp_path / "a; rm -rf b", 1, 1, "cpu")
    with pytest.raises(DegenseError, match="control characters"):
        slurm_script(tmp_path / "a\nrm", 1, 1, "cpu")


def test_what_is_done_is_reported_and_not_done_again(trained, capsys):
    assert run("--out", trained.path) == 0
    said = capsys.readouterr()
    assert "1 done" in said.out
    assert "report.md" in said.out
    assert said.err.startswith("1 of 1 done")
    assert run("--out", trained.path, "--json") == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["event"] for line in lines] == ["batch", "end"]
    assert json.loads((trained.path / "report.json").read_text())["jobs"][0]["gaussians"] > 10
    assert (trained.path / "report.csv").read_text().splitlines()[1].startswith("a,")


def test_shares_are_every_nth_job(trained, make_job, capsys):
    trained.begin([make_job("a"), make_job("broken", clip=trained.path / "nothing")])
    assert run("--out", trained.path, "--share", "0/2") == 0
    assert not (trained.path / "report.md").exists()
    assert run("--out", trained.path, "--share", "1/2", "--slots", "1") == 1  # and a job that fails is told
    assert "nothing does not exist" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--out", "{}/none"], "holds no batch to go on with"),
        (["--out", "{}/none", "--preset", "quick"], "preset belongs to clips"),
        (["{}/p.toml", "--out", "{}/o"], "p.toml cannot be read"),
        (["{}/p.toml", "{}/a", "--out", "{}/o"], "A plan names all clips"),
        (["{}/p.toml", "--seed", "3", "--out", "{}/o"], "seed stands in it"),
        (["{}/x*", "--out", "{}/o"], "finds no clips"),
        (["{}/a", "--export", "exe", "--out", "{}/o"], "no format 'exe'"),
        (["{}/a", "--out", "{}/o", "--emit", "pbs", "f"], "there is slurm"),
        (["{}/a", "--out", "{}/o", "--emit", "slurm", "f", "--share", "0/2"], "leave --share"),
    ],
)
def test_what_cannot_be_is_a_sentence(tmp_path, capsys, words, sentence):
    assert run(*(word.format(tmp_path) for word in words)) == 2
    assert sentence in capsys.readouterr().err


@pytest.fixture
def progress(make_job):
    """Four jobs, of which one was done before; `view(progress)` shows them."""

    def progress(view):
        jobs = [make_job(name) for name in ("first", "second", "third", "fourth")]
        found = BatchProgress(jobs, jobs[:1], view.changed)
        view.begin(found)
        found.tell("second", "train", 0.5, "50 of 100")
        found.tell("third", "eval", 0.1, "")
        found.ended("third", "failed", "No clip.")
        found.tell("third", "late news", 0.9, "")
        found.ended("second", "done")
        view.end()
        return found

    return progress


def test_plain_lines_say_each_stage_once(progress, capsys):
    progress(PlainLines())
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "1 of 4 done, 3 waiting"
    assert lines[1] == "second: train"
    assert lines[3].startswith("third: failed")
    assert "No clip." in lines[3]
    assert lines[-1].endswith("2 of 4 done, 1 failed, 1 waiting")


def test_events_are_json_lines(progress, capsys):
    progress(JsonLines())
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == {"event": "batch", "jobs": 4, "done": 1}
    assert [(line["job"], line["state"], line["stage"], line["fraction"]) for line in lines[1:]] == [
        ("second", "running", "train", 0.5),
        ("third", "running", "eval", 0.1),
        ("third", "failed", "eval", 0.1),
        ("second", "done", "train", 0.5),
    ]


def test_the_table_fits_the_terminal(progress, capsys, monkeypatch):
    monkeypatch.setattr(table, "DRAW_SECONDS", 0.0)
    view = TerminalTable()
    found = progress(view)
    shown = capsys.readouterr().err
    assert "second  [########........] train        50 of 100" in shown
    assert "third   failed: No clip." in shown
    assert "\x1b[2A" in shown  # drawn over what was there
    for name in ("second", "fourth"):
        found.jobs[name].state = "running"
    assert not [line for line in view.lines(80, 9) if "waiting:" in line]
    found.again("fourth", "no worker is there")
    assert "fourth  waiting: no worker is there" in view.lines(80, 9)
    found.jobs["fourth"].state = "running"
    lines = view.lines(30, 4)
    assert lines[-1] == "… and 2 more"
    assert all(len(line) < 30 for line in lines)


def test_words_of_others_stay_in_their_cell(trained, make_job):
    jobs = trained.begin([make_job("a")])
    [row] = rows_of(trained, jobs)
    assert "<script>" not in markdown([row | {"failure": "<script>a | b\n# c"}])
