"""The worker answers the last question, in order of urgency, and never blocks who asks."""

from __future__ import annotations

import threading

import pytest

from degense.app.shell.worker import Worker
from degense.engine.errors import Cancelled, ClipError


@pytest.fixture
def service(qapp):
    service = Worker()
    for urgency, channel in enumerate(("urgent", "slow")):
        service.add_channel(channel, urgency)
    yield service
    service.close()


class Answers:
    def __init__(self) -> None:
        self.done: list[object] = []
        self.failed: list[str] = []
        self.progress: list[object] = []

    def listen(self):
        return self.done.append, self.failed.append, self.progress.append


@pytest.fixture
def answers() -> Answers:
    return Answers()


def test_only_the_last_request_is_answered(qtbot, service, answers):
    gate, busy = threading.Event(), threading.Event()
    drawn: list[int] = []
    service.submit("urgent", lambda: (busy.set(), gate.wait()), *answers.listen())
    assert busy.wait(5)
    for number in range(50):
        service.submit("urgent", lambda number=number: drawn.append(number) or number, *answers.listen())
    gate.set()
    qtbot.waitUntil(lambda: answers.done == [49])
    assert drawn == [49]


def test_submitting_never_waits(service, answers):
    gate = threading.Event()
    service.submit("urgent", gate.wait, *answers.listen())
    for _ in range(1000):
        service.submit("urgent", gate.wait, *answers.listen())
    gate.set()  # never reached if one of them had waited


def test_a_long_job_lets_urgent_ones_pass_between_its_steps(qtbot, service, answers):
    order: list[str] = []
    first_step, go_on = threading.Event(), threading.Event()

    def long():
        for step in range(3):
            order.append(f"step {step}")
            first_step.set()
            go_on.wait(5)
            yield step
        return "long"

    service.submit("slow", long, *answers.listen())
    assert first_step.wait(5)
    service.submit("urgent", lambda: order.append("urgent"), *Answers().listen())
    go_on.set()
    qtbot.waitUntil(lambda: answers.done == ["long"])
    assert order == ["step 0", "urgent", "step 1", "step 2"]
    assert answers.progress == [0, 1, 2]


def test_a_cancelled_job_is_closed_in_the_worker_and_stays_silent(qtbot, service, answers):
    closed: list[str] = []
    started = threading.Event()

    def endless():
        try:
            while True:
                started.set()
                yield 0
        finally:
            closed.append(threading.current_thread().name)

    service.submit("slow", endless, *answers.listen())
    assert started.wait(5)
    service.cancel("slow")
    qtbot.waitUntil(lambda: bool(closed))
    assert closed != [threading.main_thread().name]
    assert not service.busy("slow")
    assert (answers.done, answers.failed) == ([], [])


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ClipError("The clip x has no frames."), "The clip x has no frames."),
        (ZeroDivisionError("half"), "a mistake (ZeroDivisionError: half)"),
    ],
)
def test_errors_come_back_as_sentences(qtbot, service, answers, caplog, error, text):
    def job():
        raise error

    service.submit("urgent", job, *answers.listen())
    qtbot.waitUntil(lambda: bool(answers.failed))
    assert text in answers.failed[0]
    assert ("Traceback" in caplog.text) == isinstance(error, ZeroDivisionError)
    service.submit("urgent", lambda: 1, *answers.listen())
    qtbot.waitUntil(lambda: answers.done == [1])


def test_a_job_that_gives_up_says_nothing(qtbot, service, answers):
    def job():
        raise Cancelled

    service.submit("urgent", job, *answers.listen())
    qtbot.waitUntil(lambda: not service.busy("urgent"))
    assert (answers.done, answers.failed) == ([], [])


def test_closing_drops_what_is_on_its_way(qtbot, qapp, answers):
    service = Worker()
    service.add_channel("urgent", 0)
    service.submit("urgent", lambda: 1, *answers.listen())
    service.close()
    qtbot.wait(50)
    assert answers.done == []
