"""The short form of the soak: a few rounds of work in the window leave nothing behind."""

from __future__ import annotations

import shutil

from degense.app.research.reliability.soak import state_of_process, work
from degense.app.session.sample import demo_run

ROUNDS = 3


def test_rounds_of_work_leave_nothing(window, tmp_path):
    """Curves that were drawn anew once left 350 objects a round."""
    shutil.copytree(demo_run(), tmp_path / "run")
    for number in range(2):
        work(window, tmp_path / "run", number)
    before = state_of_process()
    for number in range(ROUNDS):
        work(window, tmp_path / "run", number)
    after = state_of_process()
    assert 1000 * (after["objects"] - before["objects"]) < 100 * ROUNDS
    assert after["handles"] <= before["handles"]
