"""How instant the window is: times of what hands do, and the longest stalls of its event loop. `degense bench window` prints them.

Everything goes through the real window on the present display, with real events where there are any; every time ends when the frame that
answers has been painted.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QPointF, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from degense.app.research.event_loop import BEAT_MS, Painted, beats, rest, run_events, timed, timed_in_3d, viewer, wait
from degense.app.research.window_start import first_frame, window_on
from degense.app.session.view_state import Prompt
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.timing import percentile

if TYPE_CHECKING:
    from degense.app.shell.shell import Shell

Timing = Callable[["Shell", Callable[[], object]], float]
GAUSSIANS, QUICK_GAUSSIANS = 30_000, 2_000
WARM, STARTS, STALL_SECONDS, DRAG_SECONDS = 4, 15, 12.0, 6.0
#: What is measured: title and bar, milliseconds; None for what is only told.
BARS: dict[str, tuple[str, float | None]] = {
    "window": ("from the start of the program to the window", 1500.0),
    "start": ("from the start of the program to the first frame", 3000.0),
    "processor": ("of that, processor time of all cores", None),
    "first window": ("the first start after installing: to the window", 3000.0),
    "first start": ("to the first frame, kernels being compiled", None),
    "scrub-alone": ("scrub step, 2D view alone", 30.0),
    "scrub": ("scrub step to a frame that was drawn before: until the 2D view", None),
    "scrub-3d": ("scrub step to another: until the 3D view", 60.0),
    "scrub-prompt": ("scrub step with a prompt: until the 2D view with its mask", None),
    "scrub-prompt-3d": ("until the 3D view", 60.0),
    "dragged": ("slider dragged with a prompt: a frame in both views, with its mask", None),
    "prompt": ("warm prompt: from its words to its mask", 50.0),
    "dab": ("brush dab", 16.0),
    "still": ("longest stalls of the event loop: at rest", 50.0),
    "playing": ("longest stalls: playing", 50.0),
    "training": ("longest stalls: while a training runs", 50.0),
    "both": ("longest stalls: playing while a training runs", 50.0),
}


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """The table of the window. DegenseError without a display."""
    count = QUICK_GAUSSIANS if options.quick else GAUSSIANS
    folder, clip = prepared(options, count, lambda fraction, message: progress(0.5 * fraction, message))
    table = Table(
        "window",
        "Working in the window",
        f"A phantom scene brought to {count:,} Gaussians, in the real window, 1440 × 900, with both views shown unless said. Times end "
        "when the frame that answers is painted. Starts: bytecode and kernels kept from an earlier start. Stalls: the gaps between beats "
        f"of a timer that should beat every {BEAT_MS} ms, over {STALL_SECONDS:g} s each; the median and 95th percentile of the gaps, and "
        "the longest.",
        [
            Column("what", "what"),
            Column("median", "median, ms", 1),
            Column("late", "95th percentile, ms", 1),
            Column("longest", "longest, ms", 1),
            Column("bar", "bar, ms", 0),
            Column("held", "held"),
        ],
    )
    first_frame(folder)  # keeps bytecode and kernels
    first_window, first_start, _ = first_frame(folder, options.scratch / "no-kernels")
    starts = [first_frame(folder) for _ in range(1 if options.quick else STARTS)]
    measured = {name: list(times) for name, times in zip(("window", "start", "processor"), zip(*starts, strict=True), strict=True)}
    measured |= {"first window": [first_window], "first start": [first_start]}
    progress(0.6, "the window")
    app = QApplication.instance() or QApplication(["degense"])
    measured |= in_window(folder, clip, options, lambda fraction, message: progress(0.6 + 0.4 * fraction, message))
    for name, times in measured.items():
        title, bar = BARS[name]
        worst = max(times)
        held = "" if bar is None else "yes" if (worst if "stalls" in title else percentile(times, 95)) <= bar else "no"
        row: dict[str, Cell] = {"what": title, "median": percentile(times, 50), "late": percentile(times, 95), "longest": worst}
        table.rows.append(row | {"bar": bar, "held": held})
    app.processEvents()
    yield table


def prepared(options: BenchOptions, count: int, progress: Progress) -> tuple[Path, Path]:
    """A run folder with exactly `count` Gaussians, and its clip."""
    import shutil

    from degense.engine.research.bench.scenes import trained_scene, with_count

    scene, _ = trained_scene(options, progress)
    folder = options.scratch / "window-run"
    if not folder.exists():
        shutil.copytree(scene.run.path, folder)
        (folder / "observability.safetensors").unlink(missing_ok=True)  # it is of another number of Gaussians
        larger = with_count(scene, count)
        from degense.engine.store import Run

        Run.open(folder).save_model(larger.model)
    return folder, options.scratch / "phantom"


# -- in one window -------------------------------------------------------------------------------------------------------------------------
def in_window(folder: Path, clip: Path, options: BenchOptions, progress: Progress) -> dict[str, list[float]]:
    seconds = 2.0 if options.quick else STALL_SECONDS
    with window_on(folder) as window:
        wait(lambda: viewer(window).splats is not None and viewer(window).view is not None)
        scene, session = window.session.scene, window.session
        assert scene is not None
        for frame in range(scene.frames):  # what is baked once
            scene.splats(frame, semantics=True)
        rest(window)
        progress(0.1, "scrubbing")
        measured = scrubs(window, options.repeats)
        progress(0.3, "asking")
        measured["prompt"] = prompts(window, options.repeats)
        progress(0.4, "painting")
        measured["dab"] = dabs(window, options.repeats)
        progress(0.5, "at rest")
        measured["still"] = beats(seconds)
        session.play()
        measured["playing"] = beats(seconds)
        session.pause()
        progress(0.7, "beside a training")
        with training(clip, options.scratch / "beside"):
            measured["training"] = beats(seconds)
            session.play()
            measured["both"] = beats(seconds)
            session.pause()
        return measured


def scrubs(window: Shell, repeats: int) -> dict[str, list[float]]:
    """Steps to frames far apart, and the slider dragged through all of them; without a prompt and with one."""
    session = window.session
    assert session.scene is not None
    prompt, splats = session.scene.classes[0], viewer(window).splats
    assert splats is not None
    splats.hide()
    measured = {"scrub-alone": steps(window, "scrub", repeats, (timed,))["scrub"]}
    splats.show()
    measured |= steps(window, "scrub", repeats)
    session.view.add_prompt(prompt)
    rest(window)
    measured |= steps(window, "scrub-prompt", repeats) | {"dragged": dragged(window)}
    session.view.remove_prompt(prompt)
    rest(window)
    return measured


def steps(window: Shell, name: str, repeats: int, ways: Sequence[Timing] = (timed, timed_in_3d)) -> dict[str, list[float]]:
    """Steps to frames far apart, one at a time, until the 2D view and until the 3D view."""
    session, measured = window.session, {}
    order = iter(range(1, 2 * 7 * (repeats + WARM), 7))
    rest(window)
    for measure in ways:
        times = []
        for _ in range(repeats + WARM):
            times.append(measure(window, partial(session.go_to, next(order) % session.frames)))
            rest(window)
        measured[name + "-3d" * (measure is timed_in_3d)] = times[WARM:]
    return measured


def dragged(window: Shell) -> list[float]:
    """Milliseconds between whole views while the slider is moved there and back, once in two seconds, every 16 ms."""
    session, drawing, times = window.session, viewer(window), [time.perf_counter()]
    begin = times[0]

    def move() -> None:
        phase = (time.perf_counter() - begin) % 2
        session.go_to(round((session.frames - 1) * min(phase, 2 - phase)))

    timer = QTimer()
    timer.setTimerType(Qt.TimerType.PreciseTimer)
    timer.timeout.connect(move)
    shown = drawing.shown.connect(lambda view: times.append(time.perf_counter()))
    timer.start(16)
    run_events(DRAG_SECONDS)
    timer.stop()
    drawing.shown.disconnect(shown)
    rest(window)
    return [1000 * (later - earlier) for earlier, later in pairwise(times)]


def prompts(window: Shell, repeats: int) -> list[float]:
    """New prompts on a frame that has been asked before: each of the scene's classes in turn."""
    session = window.session
    assert session.scene is not None
    classes = session.scene.classes
    empty = session.view_state
    times = []
    for i in range(repeats + WARM):
        prompt = Prompt(classes[i % len(classes)], (230, 159, 0))

        def ask(prompt: Prompt = prompt) -> None:
            from dataclasses import replace

            session.view.edit("Prompt", replace(empty, prompts=(prompt,)))

        times.append(timed(window, ask))
        rest(window)
    session.view.edit("No prompt", empty)
    rest(window)
    return times[WARM:]


def dabs(window: Shell, repeats: int) -> list[float]:
    """Dabs of the brush, from the press of the button to the painted pixels."""
    registry, panel = window.registry, viewer(window).panel
    registry.run("annotate.mode")
    registry.run("annotate.brush")
    rest(window)
    watch, times = Painted(panel, lambda: True), []
    for i in range(repeats + WARM):
        at = QPointF(panel.width() / 2 + 40 * ((i % 5) - 2), panel.height() / 2 + 30 * ((i % 3) - 1)).toPoint()
        watch.count, start = 0, time.perf_counter()
        QTest.mousePress(panel, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, at)
        wait(lambda: watch.count > 0)
        times.append(1000 * (time.perf_counter() - start))
        QTest.mouseRelease(panel, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, at)
        rest(window)
    while window.session.undo.undo_name:
        window.session.undo.undo()
    if window.menus.actions["annotate.mode"].isChecked():
        registry.run("annotate.mode")
    rest(window)
    return times[WARM:]


@contextmanager
def training(clip: Path, out: Path) -> Iterator[None]:
    """A training in a process of its own, as the window starts them, past its loading."""
    words = ["train", str(clip), "--out", str(out), "--preset", "quick", "--events", "--device", "cpu"]
    process = subprocess.Popen(
        [sys.executable, "-m", "degense.app", *words], stdout=subprocess.PIPE, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if b'"progress"' in line:
                break
        yield
    finally:
        process.kill()
        process.communicate()
