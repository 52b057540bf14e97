"""The benchmark of the window measures what it says."""

from __future__ import annotations

import time

from PySide6.QtCore import QTimer

from degense.app.research import window_bench as bench_window
from tests.app import installed as on


def test_a_stall_is_seen_and_quiet_is_not_taken_for_one(window):
    quiet = sorted(bench_window.beats(0.4))
    QTimer.singleShot(150, lambda: time.sleep(0.3))
    assert max(bench_window.beats(0.8)) > 250
    assert quiet[len(quiet) // 2] < 50


def test_times_end_when_the_answer_is_painted(opened, idle):
    session, shown = opened.session, []
    on.viewer(opened).shown.connect(lambda view: shown.append(view.frame))
    spent = bench_window.timed(opened, lambda: session.go_to(6))
    assert shown[-1] == 6
    assert 0 < spent < 60_000
    idle()


def test_prompts_and_dabs_leave_the_session_as_it_was(opened, idle, monkeypatch):
    monkeypatch.setattr(bench_window, "WARM", 1)
    view_state = opened.session.view_state
    assert len(bench_window.prompts(opened, 2)) == 2
    assert len(bench_window.dabs(opened, 2)) == 2
    idle()
    assert opened.session.view_state == view_state
    assert not opened.menus.actions["annotate.mode"].isChecked()
