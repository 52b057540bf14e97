"""Hours of work in the window: runs are opened, played, asked, painted on and closed, and nothing may grow or slow down."""

from __future__ import annotations

import gc
import json
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from degense.app.research.event_loop import rest, run_events, viewer, wait
from degense.app.session.sample import demo_run
from degense.app.session.view_state import Prompt
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.table import Cell

if TYPE_CHECKING:
    from degense.app.shell.shell import Shell

#: Rounds at the start that are not counted (caches fill, kernels are compiled), and the least that are.
WARM, ROUNDS = 5, 12
#: What is measured after each round: title, unit, and the growth an hour that is still called flat.
MEASURED = {
    "memory": ("memory of the process", "MiB", 20.0),
    "handles": ("open handles", "", 1.0),
    "objects": ("Python objects", "thousands", 5.0),
    "seconds": ("time of a round", "s", 0.5),
    "processor": ("processor time of a round", "s", 0.5),
}


@dataclass(frozen=True)
class Slope:
    """Growth an hour, and the half width of its 95 % interval."""

    growth: float
    spread: float

    @classmethod
    def of(cls, hours: np.ndarray, values: np.ndarray) -> Slope:
        """Of a straight line through measurements, at least three: the slope, ± t · its standard error.

        Measurements near in time are alike, so that they are first averaged in up to twelve stretches, which hardly are.
        """
        from scipy.stats import t

        parts = min(12, len(hours))
        x, y = (np.array([part.mean() for part in np.array_split(of, parts)]) for of in (hours, values))
        centred = x - x.mean()
        growth = float((centred * y).sum() / (centred**2).sum())
        rest = y - y.mean() - growth * centred
        error = np.sqrt((rest**2).sum() / max(1, parts - 2) / (centred**2).sum())
        return cls(growth, float(t.ppf(0.975, max(1, parts - 2)) * error))


def soak(
    window: Shell, folder: Path, minutes: float, progress: Progress = silent, rounds: int = 0, log: Path | None = None
) -> dict[str, np.ndarray]:
    """Work in a window for so many minutes, or at least so many rounds; what was measured after each round, and "hours" since the start.

    Each round's numbers are also added to the file `log`, so that hours of work that end before their time still tell something.
    """
    runs = []
    for name in ("one", "two"):
        shutil.copytree(demo_run(), folder / name, dirs_exist_ok=True)
        runs.append(folder / name)
    measured: dict[str, list[float]] = {name: [] for name in ("hours", *MEASURED)}
    begin = time.perf_counter()
    done = 0
    while time.perf_counter() - begin < 60 * minutes or done < rounds + WARM:
        started, processor = time.perf_counter(), time.process_time()
        work(window, runs[done % 2], done)
        spent = {"seconds": time.perf_counter() - started, "processor": time.process_time() - processor}
        done += 1
        progress(min(1.0, (time.perf_counter() - begin) / max(1e-9, 60 * minutes)), f"round {done}")
        if done > WARM:
            now = {"hours": (time.perf_counter() - begin) / 3600, **spent, **state_of_process()}
            for name, value in now.items():
                measured[name].append(value)
            if log is not None:
                with log.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(now) + "\n")
    return {name: np.array(values) for name, values in measured.items()}


def work(window: Shell, run: Path, number: int) -> None:
    """One round: open a run, play, scrub, ask, paint and undo, save, look at a training's curves, close."""
    from dataclasses import replace

    from degense.app.features.documents.controller import Documents

    documents, session = window.service(Documents), window.session
    assert documents is not None
    documents.open_path(run)
    wait(lambda: session.scene is not None and viewer(window).view is not None)
    rest(window)
    session.play()
    run_events(0.3)
    session.pause()
    for frame in (3, 11, 7):
        session.go_to(frame)
        rest(window)
    assert session.scene is not None
    prompt = Prompt(session.scene.classes[number % len(session.scene.classes)], (230, 159, 0))
    session.view.edit("Prompt", replace(session.view_state, prompts=(prompt,)))
    rest(window)
    _paint(window)
    while session.undo.undo_name:
        session.undo.undo()
    rest(window)
    _training_curves(window)
    documents.close()
    wait(lambda: not documents.autosave.saver.running)  # its file is an open handle
    rest(window)


def _paint(window: Shell) -> None:
    """A stroke of the brush, with real events."""
    registry, panel = window.registry, viewer(window).panel
    registry.run("annotate.mode")
    registry.run("annotate.brush")
    rest(window)
    middle = QPoint(panel.width() // 2, panel.height() // 2)
    QTest.mousePress(panel, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, middle)
    for step in range(8):
        QTest.mouseMove(panel, middle + QPoint(5 * step, 3 * step))
        run_events(0.01)
    QTest.mouseRelease(panel, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, middle + QPoint(40, 24))
    registry.run("annotate.mode")
    rest(window)


def _training_curves(window: Shell) -> None:
    """What the panel of a training shows, without the training."""
    from degense.app.features.train.monitor import TrainingMonitor
    from degense.engine.events import TrainingProgress

    monitors: list[TrainingMonitor] = window.findChildren(TrainingMonitor)
    for monitor in monitors:
        monitor.start("soak")
        for step in range(1, 11):
            about = {"loss": 1 / step, "psnr": 20.0 + step, "gaussians": 1000, "seconds": float(step), "losses": {"colour": 1 / step}}
            monitor.set_progress(TrainingProgress(step, 10, **about))  # type: ignore[arg-type]
        monitor.reset()


def state_of_process() -> dict[str, float]:
    """Memory in MiB, open handles and thousands of Python objects, when all that can go has gone."""
    for _ in range(3):
        QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        QApplication.processEvents()
        gc.collect()
    with open("/proc/self/statm", encoding="ascii") as file:
        pages = int(file.read().split()[1])
    memory = pages * os.sysconf("SC_PAGESIZE") / 2**20
    return {"memory": memory, "handles": float(len(os.listdir("/proc/self/fd"))), "objects": len(gc.get_objects()) / 1000}


def rows(folder: Path, minutes: float, progress: Progress = silent, log: Path | None = None) -> list[dict[str, Cell]]:
    """The lines of the table: what was measured at the beginning and the end, and whether it grows. See `soak`."""
    from degense.app.research.window_start import window_on

    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    shutil.copytree(demo_run(), folder / "first")
    with window_on(folder / "first") as window:
        wait(lambda: window.session.scene is not None)
        rest(window)
        found = soak(window, folder, minutes, progress, ROUNDS, log)
    lines: list[dict[str, Cell]] = []
    for name, (title, unit, flat) in MEASURED.items():
        values, slope = found[name], Slope.of(found["hours"], found[name])
        tenth = max(1, len(values) // 10)
        ends: dict[str, Cell] = {"first": float(values[:tenth].mean()), "last": float(values[-tenth:].mean())}
        grows = slope.growth - slope.spread > 0 and slope.growth > flat
        about: dict[str, Cell] = {"what": f"{title}{f', {unit}' * bool(unit)}", "rounds": len(values), "growth": slope.growth}
        lines.append({**about, **ends, "spread": slope.spread, "flat": "no" if grows else "yes"})
    return lines
