"""The training process, with small children that behave well and badly."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from degense.app.features.train import process as training_process
from degense.app.features.train.job import TrainingJob
from degense.app.features.train.process import EventLines, TrainingProcess
from degense.engine.events import Done, Stage, Stopped, TrainingProgress, to_json

JOB = TrainingJob(Path("clip"), Path("run"))


@pytest.fixture
def child(qtbot, qapp):
    """Start Python code as the training; its outcomes are collected in the order they come."""
    processes: list[TrainingProcess] = []

    def child(code: str) -> tuple[TrainingProcess, list[tuple[str, object]]]:
        process = TrainingProcess(JOB, command=[sys.executable, "-u", "-c", code])
        heard: list[tuple[str, object]] = []
        process.told.connect(lambda event: heard.append(("event", event)))
        process.finished.connect(lambda run: heard.append(("finished", run)))
        process.stopped.connect(lambda: heard.append(("stopped", None)))
        process.failed.connect(lambda message: heard.append(("failed", message)))
        processes.append(process)
        process.start()
        return process, heard

    yield child
    for process in processes:
        assert not process.running


def ended(heard: list[tuple[str, object]]) -> bool:
    return any(kind != "event" for kind, _ in heard)


@given(st.lists(st.binary(max_size=8), max_size=20), st.data())
def test_lines_are_found_however_they_are_cut(pieces, data):
    events = [Stopped(number) for number in range(3)]
    noise = [piece.replace(b"\n", b"") for piece in pieces] + [b""] * 3
    stream = b"".join(json.dumps(to_json(event)).encode() + b"\n" + piece + b"\n" for event, piece in zip(events, noise, strict=False))
    lines, found = EventLines(), []
    while stream:
        cut = data.draw(st.integers(1, len(stream)))
        found += lines.feed(stream[:cut])[0]
        stream = stream[cut:]
    assert [event for event in found if event in events] == events


def test_an_endless_line_is_not_gathered():
    lines = EventLines()
    for _ in range(5):
        lines.feed(b"x" * training_process.MAX_LINE)
    assert len(lines._rest) <= training_process.MAX_LINE


def test_events_arrive_between_garbage(qtbot, child):
    _, heard = child(
        "import sys, json\n"
        "print('hello'); print('{\"event\": 3}'); print('[]'); sys.stdout.buffer.write(b'\\xff\\xfe\\n')\n"
        "print(json.dumps({'event': 'progress', 'iteration': 1, 'iterations': 2}))\n"
        "print(json.dumps({'event': 'done', 'run': 'here'}))"
    )
    qtbot.waitUntil(lambda: ended(heard))
    assert [entry for entry in heard if entry[0] == "event"] == [
        ("event", TrainingProgress(1, 2)),
        ("event", Done("here")),
    ]
    assert heard[-1] == ("finished", "here")


OBEDIENT = """
import sys
print('{"event": "stage", "stage": "load"}')
assert sys.stdin.readline() == "stop\\n"
print('{"event": "stopped", "iteration": 5}')
"""

DEAF = """
import signal, time
signal.signal(signal.SIGTERM, lambda *_: print('{"event": "stage", "stage": "terminated"}'))
print('{"event": "stage", "stage": "ready"}')
while True:
    time.sleep(1)
"""


def test_stop_is_asked_for_in_words(qtbot, child):
    process, heard = child(OBEDIENT)
    qtbot.waitUntil(lambda: bool(heard))
    process.stop()
    qtbot.waitUntil(lambda: ended(heard))
    assert heard[-1] == ("stopped", None)


def test_who_does_not_listen_is_terminated_and_then_killed(qtbot, child, monkeypatch):
    monkeypatch.setattr(training_process, "SAVE_SECONDS", 0.2)
    monkeypatch.setattr(training_process, "TERMINATE_SECONDS", 0.2)
    process, heard = child(DEAF)
    qtbot.waitUntil(lambda: bool(heard))
    process.stop()
    qtbot.waitUntil(lambda: ended(heard))
    assert [event for kind, event in heard if kind == "event"] == [Stage("ready"), Stage("terminated")]
    assert heard[-1] == ("stopped", None)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ('print(\'{"event": "error", "message": "The clip has no frames."}\'); raise SystemExit(2)', "The clip has no frames."),
        ("import sys; print('degense: RUN is not empty.', file=sys.stderr); raise SystemExit(2)", "RUN is not empty."),
        ("raise SystemExit(7)", "status 7"),
        ("import os; os.kill(os.getpid(), 9)", "ended by the system"),
    ],
)
def test_failures_are_sentences(qtbot, child, code, words):
    _, heard = child(code)
    qtbot.waitUntil(lambda: ended(heard))
    kind, message = heard[-1]
    assert kind == "failed"
    assert words in str(message)
    assert "Traceback" not in str(message)


def test_a_program_that_is_not_there(qtbot, qapp, tmp_path):
    process = TrainingProcess(JOB, command=[str(tmp_path / "nothing")])
    with qtbot.waitSignal(process.failed):
        process.start()
    assert not process.running


def test_the_job_is_the_command_line():
    from degense.app.cli.parser import build_parser

    job = TrainingJob(Path("a clip"), Path("run"), "quick", "paper", "none", 7, 99, "cpu", 5, True, "frames", "keep", 321.5)
    job = replace(job, poses="still", pose_axes="opencv", start=3, stride=2, max_frames=50, settings=(("flow", "10"), ("levels", "[1]")))
    options = build_parser()[0].parse_args(job.arguments())
    named = {name: getattr(options, name) for name in vars(job)}
    assert named | {"settings": tuple(options.settings)} == vars(job)
    assert options.events
