"""Twenty tasks, each done by the mouse alone and by the keyboard alone, with what that takes.

`DEGENSE_TASKS=docs/tasks.md` writes the table that the documents show, in one process; without it the steps of that table are held to
what is counted here.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from tests.app import installed as on
from tests.app.tasks.hands import Keys, Mouse
from tests.app.tasks.tasks import TASKS

DOCUMENT = Path(__file__).parents[3] / "docs" / "tasks.md"
HANDS = {"mouse": Mouse, "keyboard": Keys}
#: What both hands took, by name: (steps, seconds) of each task.
taken: dict[str, list[tuple[int, float]]] = {}


@pytest.fixture
def begun(window, idle, run, own_folders, qtbot):
    """The welcome page, with the tiny run among what was open lately."""
    on.documents(window).open_path(run)
    idle()
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_W, Qt.KeyboardModifier.ControlModifier)
    idle()
    window.resize(1440, 900)
    qtbot.wait(50)
    assert window.session.scene is None
    before = set(run.parent.iterdir())
    yield window
    for exported in set(run.parent.iterdir()) - before:
        shutil.rmtree(exported) if exported.is_dir() else exported.unlink()


@pytest.mark.parametrize("hand", list(HANDS))
def test_every_task(hand, begun, idle, qtbot, screenshot):
    taken[hand] = []
    for number, task in enumerate(TASKS, 1):
        hands = HANDS[hand](begun, idle, qtbot.waitUntil)
        print(task.wanted)  # which one failed
        start = time.perf_counter()
        (task.by_mouse if hand == "mouse" else task.by_keys)(hands, begun)
        qtbot.waitUntil(lambda task=task: bool(task.done(begun)), timeout=20_000)
        taken[hand].append((hands.steps, time.perf_counter() - start))
        idle()
        if "DEGENSE_SCREENSHOTS" in os.environ:
            screenshot(begun, f"task-{number:02}-{hand}")
    if (name := os.environ.get("DEGENSE_TASKS")) and set(taken) == set(HANDS):
        Path(name).write_text(page(), encoding="utf-8")
    elif not name:
        rows = re.findall(r"^\| \d+ \| (.+?) \| (\d+) \| .+? \| (\d+) \|", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE)
        told = [(row[0], int(row[1 + list(HANDS).index(hand)])) for row in rows]
        assert told == [(task.wanted, steps) for task, (steps, _) in zip(TASKS, taken[hand], strict=True)]


def page() -> str:
    """The table of the documents."""
    lines = [
        "# Twenty tasks, by either hand",
        "",
        "What a first session is made of, done in the window by events that the window system sends: once by the mouse alone, once by",
        "the keyboard alone. A step is a click, a drag, a key with those that are held, or a typed text. Seconds are those of the program:",
        "from the first step until the window shows what was wanted, with no pause between steps, on two cores that had other work too.",
        "Made by `DEGENSE_TASKS=docs/tasks.md make test TESTS='-n 0 tests/app/tasks'`; a test holds the steps to this table.",
        "",
        "| | task | mouse: steps | seconds | keyboard: steps | seconds |",
        "|---|---|---|---|---|---|",
    ]
    for number, (task, mouse, keys) in enumerate(zip(TASKS, taken["mouse"], taken["keyboard"], strict=True), 1):
        lines.append(f"| {number} | {task.wanted} | {mouse[0]} | {mouse[1]:.1f} | {keys[0]} | {keys[1]:.1f} |")
    sums = [f"{sum(of[0] for of in taken[hand])} | {sum(of[1] for of in taken[hand]):.1f}" for hand in HANDS]
    return "\n".join([*lines, f"| | all | {sums[0]} | {sums[1]} |"]) + "\n"
