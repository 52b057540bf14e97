"""The twenty tasks of a first session, one after the other in one window: how each is done by either hand, and how one sees that it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtWidgets import QWidget

from degense.app.features.export.label_dialog import LabelExportDialog
from degense.app.features.welcome.page import WelcomePage
from degense.app.session.targets import Spot
from degense.app.shell.shell import Shell
from tests.app import installed as on
from tests.app.tasks.hands import Keys, Mouse

CONTROL, SHIFT, ALT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier, Qt.KeyboardModifier.AltModifier
Key = Qt.Key


@dataclass(frozen=True)
class Task:
    """What is wanted, how it is done by the mouse and by the keyboard, and whether the window has done it."""

    wanted: str
    by_mouse: Callable[[Mouse, Shell], None]
    by_keys: Callable[[Keys, Shell], None]
    done: Callable[[Shell], bool]


def spot(window: Shell, x: float, y: float) -> QPoint:
    """Where a pixel of the frame is in the 2D view."""
    return on.viewer(window).panel.zoom.to_widget(QPointF(x, y)).toPoint()


def click_frame(hand: Mouse, window: Shell, *pixels: tuple[float, float]) -> None:
    for pixel in pixels:
        hand.click(on.viewer(window).panel, spot(window, *pixel))


def child(window: Shell, name: str) -> QWidget:
    """What a screen reader would call so."""
    [found] = [widget for widget in window.findChildren(QWidget) if widget.accessibleName() == name and widget.isVisible()]
    return found


def open_recent_by_mouse(hand: Mouse, window: Shell) -> None:
    recent = on.found(window, WelcomePage).recent
    hand.click(recent.viewport(), recent.visualItemRect(recent.item(0)).center())


def open_recent_by_keys(hand: Keys, window: Shell) -> None:
    recent = on.found(window, WelcomePage).recent
    for _ in range(20):
        if window.focusWidget() is recent:
            break
        hand.press(Key.Key_Tab)
    hand.press(Key.Key_Home, Key.Key_Return)


def to_frame_6_by_mouse(hand: Mouse, window: Shell) -> None:
    track = on.time(window).timeline.track
    hand.click(track, QPoint(round(track._x(6)), track.height() // 2))


def play_by_mouse(hand: Mouse, window: Shell) -> None:
    start = window.session.frame
    hand.click(child(window, "Play"))
    hand.until(lambda: window.session.frame != start)
    hand.click(child(window, "Pause"))


def play_by_keys(hand: Keys, window: Shell) -> None:
    start = window.session.frame
    hand.press(Key.Key_Space)
    hand.until(lambda: window.session.frame != start)
    hand.press(Key.Key_Space)


def prompt_by_mouse(hand: Mouse, window: Shell) -> None:
    hand.click(child(window, "Choose a name that this run knows"))
    hand.pick("gallbladder")


def prompt_by_keys(hand: Keys, window: Shell) -> None:
    hand.press(Key.Key_Slash)
    hand.type("gallbladder")
    hand.press(Key.Key_Return)
    hand.press(Key.Key_F6)  # out of the field


def worst_by_mouse(hand: Mouse, window: Shell) -> None:
    hand.choose("Inspect", "Find the worst places")
    table = on.findings(window).table
    hand.click(table.viewport(), table.visualItemRect(table.item(0, 0)).center())


def track_by_mouse(hand: Mouse, window: Shell) -> None:
    hand.choose("Inspect", "Track points")
    click_frame(hand, window, (40, 30))
    hand.choose("Inspect", "Track points")


def in_view(hand: Keys, window: Shell) -> None:
    """Go on to the 2D view."""
    for _ in range(12):
        if window.focusWidget() is on.viewer(window).panel:
            return
        hand.press(Key.Key_F6)
    raise AssertionError("F6 never came to the 2D view")


def point_at(hand: Keys) -> None:
    """The pointer by keys, ten pixels further left than where it was."""
    hand.press(Key.Key_Z)
    hand.press(Key.Key_Left, held=SHIFT)


def track_by_keys(hand: Keys, window: Shell) -> None:
    hand.press(Key.Key_T)
    in_view(hand, window)
    point_at(hand)
    hand.press(Key.Key_Space, Key.Key_Escape, Key.Key_T)


def measure_by_mouse(hand: Mouse, window: Shell) -> None:
    hand.choose("Inspect", "Measure", "Measure a distance")
    click_frame(hand, window, (30, 30), (60, 45))


def measure_by_keys(hand: Keys, window: Shell) -> None:
    hand.press(Key.Key_D, held=SHIFT)
    in_view(hand, window)
    point_at(hand)
    hand.press(Key.Key_Space)
    hand.press(Key.Key_Left, held=SHIFT)
    hand.press(Key.Key_Space, Key.Key_Escape)


def turn_by_mouse(hand: Mouse, window: Shell) -> None:
    hand.choose("View", "Free camera")
    view = on.viewer(window).splats
    hand.drag(view, view.rect().center(), view.rect().center() + QPoint(60, 10))


def turn_by_keys(hand: Keys, window: Shell) -> None:
    hand.press(Key.Key_V)
    for _ in range(12):
        if on.viewer(window).splats.isAncestorOf(window.focusWidget()):
            break
        hand.press(Key.Key_F6)
    hand.press(Key.Key_Right, Key.Key_Right, held=CONTROL)


def paint_by_mouse(hand: Mouse, window: Shell) -> None:
    hand.choose("Annotate", "Annotate")
    hand.drag(on.viewer(window).panel, spot(window, 20, 60), spot(window, 50, 60))


def paint_by_keys(hand: Keys, window: Shell) -> None:
    hand.press(Key.Key_A)
    in_view(hand, window)
    hand.press(Key.Key_7)  # another class than what is there
    point_at(hand)
    hand.press(Key.Key_Return)
    hand.press(Key.Key_Left, Key.Key_Left, held=SHIFT)
    hand.press(Key.Key_Return, Key.Key_Escape)


def export_by_mouse(hand: Mouse, window: Shell) -> None:
    hand.choose("File", "Export", "Masks or annotations")
    hand.click(dialog(window).start)


def export_by_keys(hand: Keys, window: Shell) -> None:
    hand.press(Key.Key_E, held=CONTROL | ALT)
    dialog(window)
    hand.press(Key.Key_Return)


def dialog(window: Shell) -> LabelExportDialog:
    """The dialog, with the keyboard, which a window manager would give it."""
    found = window.findChild(LabelExportDialog)
    found.activateWindow()
    found.path.line.setFocus()
    return found


def press(*keys: Qt.Key, held: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier) -> Callable[[Keys, Shell], None]:
    return lambda hand, window: hand.press(*keys, held=held)


def choose(*titles: str) -> Callable[[Mouse, Shell], None]:
    return lambda hand, window: hand.choose(*titles)


def probe_by_keys(hand: Keys, window: Shell) -> None:
    in_view(hand, window)
    point_at(hand)
    hand.press(Key.Key_Space, Key.Key_Escape)


def painted(window: Shell) -> bool:
    return any(record.by_hand for record in on.annotations(window).work.records.values())


def masks(window: Shell) -> list[bool]:
    return [prompt.visible for prompt in window.session.view_state.prompts]


TASKS = (
    Task("open what was open lately", open_recent_by_mouse, open_recent_by_keys, lambda w: w.session.scene is not None),
    Task("go to frame 6", to_frame_6_by_mouse, press(*6 * [Key.Key_Right]), lambda w: w.session.frame == 6),
    Task(
        "play, and pause",
        play_by_mouse,
        play_by_keys,
        lambda w: not on.time(w).timeline.is_playing(),
    ),
    Task(
        "show the displacement",
        choose("View", "Layer", "Displacement"),
        press(Key.Key_6),
        lambda w: w.session.view_state.layer == "displacement" and on.viewer(w).view.span is not None,
    ),
    Task("find the gallbladder", prompt_by_mouse, prompt_by_keys, lambda w: masks(w) == [True] and on.viewer(w).view.masks.any()),
    Task(
        "hide its mask",
        lambda hand, w: hand.click(child(w, "Hide gallbladder")),
        press(Key.Key_1, held=ALT),
        lambda w: masks(w) == [False],
    ),
    Task(
        "show it again", lambda hand, w: hand.click(child(w, "Show gallbladder")), press(Key.Key_1, held=ALT), lambda w: masks(w) == [True]
    ),
    Task(
        "ask in which frames it is",
        choose("Inspect", "Query whole clip"),
        press(Key.Key_Q),
        lambda w: w.statusBar().currentMessage().startswith("The whole clip: gallbladder"),
    ),
    Task(
        "compare with the recording",
        choose("View", "Compare", "Wipe"),
        press(Key.Key_C),
        lambda w: w.session.view_state.compare == "wipe" and on.viewer(w).view.observed is not None,
    ),
    Task(
        "read the values of a place",
        lambda hand, w: click_frame(hand, w, (45, 35)),
        probe_by_keys,
        lambda w: isinstance(w.session.probe, Spot),
    ),
    Task(
        "see where it moved most",
        worst_by_mouse,
        lambda hand, w: (hand.press(Key.Key_W, held=SHIFT), hand.press(Key.Key_N)),
        lambda w: w.session.frame == on.findings(w).findings()[0].frame,
    ),
    Task("follow a point", track_by_mouse, track_by_keys, lambda w: len(on.tracking(w).state.points) == 1),
    Task("measure a distance", measure_by_mouse, measure_by_keys, lambda w: np.isfinite(on.measuring(w).quantities()[0].values).any()),
    Task(
        "mark an event",
        choose("Play", "Mark an event"),
        press(Key.Key_E, held=SHIFT),
        lambda w: len(on.events(w).state.notes) == 1,
    ),
    Task("turn the scene in 3D", turn_by_mouse, turn_by_keys, lambda w: w.session.camera_mode == "free"),
    Task(
        "keep that camera",
        choose("View", "Cameras", "Keep this camera"),
        press(Key.Key_B, held=CONTROL),
        lambda w: len(on.cameras(w).book.stops) == 1,
    ),
    Task("go back to the surgeon’s camera", choose("View", "Free camera"), press(Key.Key_V), lambda w: w.session.camera_mode == "surgeon"),
    Task("paint a label", paint_by_mouse, paint_by_keys, painted),
    Task("take that back", choose("Edit", "Undo"), press(Key.Key_Z, held=CONTROL), lambda w: not painted(w)),
    Task(
        "export the masks",
        export_by_mouse,
        export_by_keys,
        lambda w: w.statusBar().currentMessage().startswith("Saved "),
    ),
)
