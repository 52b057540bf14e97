"""Work on a drive that stalls for seconds: a training, and in the window opening, choosing labels, playing, painting and saving.

Nothing may be lost, the window must stay alive, and a stop be answered. How long the window stood still at most is told.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.app.research.reliability.stalls import stall

if TYPE_CHECKING:
    from degense.app.features.annotate.state import AnnotationState
    from degense.app.features.documents.controller import Documents
    from degense.app.shell.shell import Shell

STALL = 1.0  # seconds of each call on the drive
SHORT_STALL = 0.25  # where some eighty calls are waited for
LONGEST_GAP = 500.0  # milliseconds that the window may stand still
SAVED, CLASS = (1, 2, 3), "swab"  # frames of which a label map is saved, and what is labelled in them
SAID = "said.txt"  # in the folder of a case: what it found
TINY: dict[str, Any] = {"iterations": 30, "max_gaussians": 300, "device": "cpu"}


def prepare(folder: Path) -> None:
    """A clip and its run on what will stall, with a session and label maps."""
    from degense.app.research.reliability import samples
    from degense.engine.data.readers import open_clip
    from degense.engine.training import TrainConfig, train

    samples.phantom(folder / "drive" / "clip")
    config = TrainConfig.preset_of("quick", **TINY)
    train(open_clip(folder / "drive" / "clip"), folder / "drive" / "run", config, events=lambda event: None, stop=lambda: False)
    _label(folder)


def _label(folder: Path) -> None:
    from degense.app.features.annotate.state import AnnotationState
    from degense.app.session.session import Session
    from degense.engine.annotation.painting import PixelRegion
    from degense.engine.scene import Scene

    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    session = Session()
    annotations = AnnotationState(session)
    session.register("annotations", annotations)
    session.open_scene(Scene.open(folder / "drive" / "run", device="cpu"))
    annotations.add_class(CLASS)
    for frame in SAVED:
        session.go_to(frame)
        annotations.paint("Brush", PixelRegion(0, frame, np.ones((8, 8), bool)), annotations.tool.label)
    session.go_to(0)
    session.save()
    session.close()


def train_and_stop(folder: Path) -> None:
    """A training that keeps checkpoints on the drive leaves soon after it was asked to, and goes on from its last one."""
    from degense.engine.data.readers import open_clip
    from degense.engine.training import TrainConfig, train

    clip, out = open_clip(folder / "drive" / "clip"), folder / "drive" / "stopped"
    begun, asked = list[float](), list[float]()

    def stop() -> bool:
        now = time.monotonic()
        if not begun and (out / "checkpoints" / "last.json").is_file():
            begun.append(now)
            stall(folder / "drive", STALL)
        if begun and now - begun[0] > 3 * STALL:
            asked.append(now)
        return bool(asked)

    config = TrainConfig.preset_of("quick", max_gaussians=300, iterations=100_000, checkpoint_seconds=0.5, device="cpu")
    assert train(clip, out, config, events=lambda event: None, stop=stop) is None
    left = time.monotonic() - asked[0]
    stall(folder / "drive", 0)
    _say(folder, f"it kept a checkpoint and left {left:.0f} s after it was asked to, {_every()}")
    assert left < 60 * STALL, f"it left after {left:.0f} s"
    assert train(clip, out, config, resume=True, events=lambda event: None, stop=lambda: True) is None


def open_in_window(folder: Path) -> None:
    """Opening a run takes as long as its files do; the window goes on meanwhile."""
    with _window(folder) as window, _gaps(folder, window, SHORT_STALL) as until:
        stall(folder / "drive", SHORT_STALL)
        _documents(window).open_path(folder / "drive" / "run")
        until(lambda: window.session.scene is not None)
        stall(folder / "drive", 0)


def choose_labels(folder: Path) -> None:
    """With the tool of annotations on, frames are chosen of which label maps are saved."""
    from degense.app.research.event_loop import viewer

    with _window(folder) as window:
        _open(window, folder)
        state = _annotations(window)
        state.tool.active = True
        _rest(window)
        with _gaps(folder, window) as until:
            stall(folder / "drive", STALL)
            for frame in SAVED:
                window.session.go_to(frame)
                until(lambda: (view := viewer(window).view) is not None and view.frame == window.session.frame)
            stall(folder / "drive", 0)
        label = [kind.name for kind in state.ready().classes].index(CLASS)
        found = [bool((state.labels(frame)[:8, frame : frame + 8] == label).all()) for frame in SAVED]
        assert all(found), f"{found.count(False)} label maps are not as they were saved"


def play_in_window(folder: Path) -> None:
    """Each recorded frame is read from the drive while time runs."""
    with _window(folder) as window:
        _open(window, folder)
        window.session.view.set_compare("wipe")
        with _gaps(folder, window) as until:
            stall(folder / "drive", STALL)
            window.session.play()
            begin = time.monotonic()
            until(lambda: time.monotonic() - begin > 4 * STALL)
            window.session.pause()
            stall(folder / "drive", 0)


def paint_and_save(folder: Path) -> None:
    """A stroke every 50 ms, while the session is saved on the drive: all strokes are there when it is opened again."""
    from degense.app.features.documents.autosave import Autosave
    from degense.app.research.event_loop import wait
    from degense.engine.annotation.painting import PixelRegion

    with _window(folder) as window:
        _open(window, folder)
        state, saver = _annotations(window), window.service(Autosave)
        assert saver is not None
        state.tool.active = True
        wait(window.worker.idle)
        strokes = 0
        with _gaps(folder, window) as until:
            stall(folder / "drive", STALL)
            begin = last = time.monotonic()

            def work() -> bool:
                nonlocal strokes, last
                now = time.monotonic()
                if now - last > 0.05:
                    last, strokes = now, strokes + 1
                    state.paint("Brush", PixelRegion(*divmod(strokes, 60), np.ones((1, 1), bool)), 1)
                    if strokes % 40 == 1:
                        saver.save()
                return now - begin > 8 * STALL

            until(work)
        before = _painted(state, strokes)
        assert before == strokes, f"{before} of {strokes} strokes are shown"
        stall(folder / "drive", 0)
    with _window(folder) as window:
        _open(window, folder)
        if window.session.store.unsaved:
            window.session.recover()
        found = _painted(_annotations(window), strokes)
        assert found == strokes, f"{found} of {strokes} strokes are left"


def _painted(state: AnnotationState, strokes: int) -> int:
    labels = state.labels(0)
    return sum(bool(labels[divmod(number, 60)] == 1) for number in range(1, strokes + 1))


# -- the window ----------------------------------------------------------------------------------------------------------------------------
@contextmanager
def _window(folder: Path) -> Iterator[Shell]:
    """The window on no screen, with settings and a journal that do not stall."""
    os.environ |= {"QT_QPA_PLATFORM": "offscreen", "XDG_STATE_HOME": str(folder / "state"), "XDG_CACHE_HOME": str(folder / "cache")}
    from PySide6.QtWidgets import QApplication

    from degense.app.application import FEATURES
    from degense.app.research.event_loop import wait
    from degense.app.shell.settings import SettingsFile
    from degense.app.shell.shell import Shell

    QApplication.instance() or QApplication([])
    window = Shell(SettingsFile(folder / "settings.json"), FEATURES)
    window.show()
    yield window
    stall(folder / "drive", 0)
    window.close()
    wait(lambda: not window.isVisible())


@contextmanager
def _gaps(
    folder: Path, window: Shell, seconds: float = STALL, longest: float = LONGEST_GAP
) -> Iterator[Callable[[Callable[[], bool]], None]]:
    """Hands over a way to run the event loop until something is so, and tells the longest time in which it did not turn."""
    from degense.app.research.event_loop import run_events

    gaps: list[float] = []
    last = time.perf_counter()

    def until(there: Callable[[], bool]) -> None:
        nonlocal last
        end = time.perf_counter() + 60
        while not there():
            run_events(0.004)
            gaps.append(1000 * (time.perf_counter() - last))
            last = time.perf_counter()
            assert last < end, "it does not come to an end"

    yield until
    until(lambda: window.worker.idle("diagnostics"))
    _say(folder, f"the window stood still for at most {max(gaps):.0f} ms, {_every(seconds)}")
    assert max(gaps) < longest, f"the window stood still for {max(gaps):.0f} ms"


def _open(window: Shell, folder: Path) -> None:
    from degense.app.research.event_loop import wait

    _documents(window).open_path(folder / "drive" / "run")
    wait(lambda: window.session.scene is not None)
    _rest(window)


def _rest(window: Shell) -> None:
    from degense.app.research.event_loop import wait

    wait(lambda: window.worker.idle("diagnostics"))


def _documents(window: Shell) -> Documents:
    from degense.app.features.documents.controller import Documents

    found = window.service(Documents)
    assert found is not None
    return found


def _annotations(window: Shell) -> AnnotationState:
    from degense.app.features.annotate.controller import Annotator

    annotator = window.service(Annotator)
    assert annotator is not None
    return annotator.state


def _every(seconds: float = STALL) -> str:
    return f"every call on the drive for {seconds:g} s"


def _say(folder: Path, words: str) -> None:
    (folder / SAID).write_text(words, encoding="utf-8")
