"""Values under the cursor, and the curves of what was clicked, outlined or named."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject
from PySide6.QtGui import QColor

from degense.app.features.inspect.curves import Curves, follow, means, to_csv
from degense.app.features.inspect.probe_maps import ProbeMaps, probe_maps
from degense.app.features.inspect.probe_panel import ProbePanel
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.app.features.viewer.layer_images import get_layer, write_png
from degense.app.session.targets import Found, Region, Spot, Target, material
from degense.app.session.view_state import ViewState
from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.layer_titles import with_unit
from degense.widgets.frame.panel_tools import RegionTool
from degense.widgets.qt_images import to_array
from degense.widgets.splats.guides import Guide

if TYPE_CHECKING:
    from degense.engine.scene import Scene


#: Colours of lines in 3D.
TRAIL, LENGTH = (255, 200, 60), (120, 230, 255)


class Probe(QObject):
    """Hovering looks values up in maps that are drawn once a frame; a click, an outline or a prompt's mask is followed through time."""

    def __init__(self, viewer: Viewer, guides: GuideSwitches) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session, self.worker = viewer, viewer.shell, viewer.session, viewer.worker
        session = self.session
        self.panel = ProbePanel()
        self.dock = self.shell.add_dock("Curves", self.panel)
        self._maps: ProbeMaps | None = None
        self._start: np.ndarray | None = None  # [T, 3], of the length that is measured
        self._guides = guides
        self._guides.offer("trail", "Trail of what is followed", self.trail)
        self._guides.offer("length", "Measured length", self.length)
        self._cursor: tuple[int, int] | None = None
        self._tools = {"rectangle": RegionTool(False, self), "lasso": RegionTool(True, self)}
        self.curves: Curves | None = None
        for tool in self._tools.values():
            tool.drawn.connect(self._outlined)
        viewer.panel.hovered.connect(self._hovered)
        viewer.panel.clicked.connect(self._clicked)
        self.panel.unpin_requested.connect(self.unpin)
        self.panel.frame_clicked.connect(session.go_to)
        viewer.shown.connect(lambda view: self._look_up())
        viewer.splats_added.connect(lambda splats: splats.picked.connect(self._picked))
        session.opened.connect(self._opened)
        session.probe_changed.connect(self._probe_changed)
        session.view_state_changed.connect(self._view_state_changed)
        session.frame_changed.connect(self._frame_changed)

    def _opened(self) -> None:
        self._maps = self._cursor = self._start = None
        self.worker.cancel("probe")
        self.worker.cancel("curves")
        self.dock.setEnabled(self.session.scene is not None)
        self.viewer.panel.click_hint = "Click: follow this place" if self.session.scene is not None else ""
        self.viewer.panel.show_hint()
        self.panel.clear()
        self._clear_curves()
        self._mark(None)

    # Hovering

    def _hovered(self, x: int, y: int) -> None:
        self._cursor = (x, y) if x >= 0 else None
        self._look_up()

    def _look_up(self) -> None:
        self._draw_maps()
        self._show_values()

    def _draw_maps(self) -> None:
        """Request the maps of this frame when they will be shown, and nothing is moving."""
        scene, frame = self.session.scene, self.session.frame
        still = not self.viewer.pacing.quick and self.viewer.free_camera() is None
        wanted = scene is not None and still and (self._cursor or isinstance(self.session.probe, Spot))
        if not wanted or (self._maps is not None and self._maps.frame == frame):
            return
        assert scene is not None
        self._maps = None
        self.worker.submit("probe", lambda: probe_maps(scene, frame), self._take_maps, self.shell.say, self._take_maps)

    def _take_maps(self, maps: ProbeMaps) -> None:
        if maps.frame == self.session.frame:
            self._maps = maps
            self._show_values()

    def _show_values(self) -> None:
        """The numbers of what the heading names: the spot that is followed, the mean over a region or mask, else what the pointer is on."""
        maps, place = self._maps, self.session.probe
        if isinstance(place, Region | Found):
            self.panel.set_values(means(self.curves, self.session.frame) if self.curves is not None else [])
            return
        at = self._cursor if place is None else (place.x, place.y)
        if at is None or maps is None or maps.frame != self.session.frame:
            return
        x, y = int(at[0]), int(at[1])
        if 0 <= y < maps.rgb.shape[0] and 0 <= x < maps.rgb.shape[1]:
            self.panel.set_values(maps.rows(x, y))
            self.panel.set_colour(QColor(*maps.colour(x, y)))

    # Choosing a place

    def _clicked(self, x: int, y: int) -> None:
        if self.session.scene is not None and self.viewer.is_surgeons():
            self.session.probe = Spot(self.session.frame, x + 0.5, y + 0.5)

    def _picked(self, index: int) -> None:
        view = self.viewer.view
        if index >= 0 and view is not None and view.splats is not None:
            pixel, depth = view.camera.project(view.splats.means[index].astype(float))
            if depth > 0 and 0 <= pixel[0] < view.camera.width and 0 <= pixel[1] < view.camera.height:
                self.session.probe = Spot(round(view.frame), float(pixel[0]), float(pixel[1]))
            else:
                self.shell.say("The surgeon's camera does not see this spot.")

    def take_tool(self, name: str | None) -> None:
        """Activate the tool for regions (`rectangle`, `lasso`); the active one, or None, deactivates it."""
        tool = self._tools[name] if name else None
        self.viewer.panel.set_tool(None if tool is self.viewer.panel.tool else tool)
        if self.viewer.panel.tool is not None:
            self.shell.say("Draw around what is to be followed; the right button pans.")
        self.shell.refresh()

    def has_tool(self, name: str) -> bool:
        return self.viewer.panel.tool is self._tools[name]

    def _outlined(self, outline: list[tuple[float, float]]) -> None:
        self.take_tool(None)
        if self.session.scene is not None and self.viewer.is_surgeons():
            self.session.probe = Region(self.session.frame, tuple(outline))

    def follow_mask(self) -> None:
        """Follow what the first visible prompt finds; with several, each call takes the next."""
        texts = [prompt.text for prompt in self.session.view_state.visible_prompts]
        place = self.session.probe
        last = texts.index(place.prompt) if isinstance(place, Found) and place.prompt in texts else -1
        self.session.probe = Found(texts[(last + 1) % len(texts)])

    def unpin(self) -> None:
        self.session.probe = None

    # Following it

    def _probe_changed(self, place: Target | None) -> None:
        self._clear_curves()
        self._mark(place)
        self.panel.set_values([])
        self.panel.set_colour(None)
        self.panel.set_pinned(str(place) if place is not None else "")
        if place is None:
            self.worker.cancel("curves")
            self._look_up()
            return
        self._follow(place)
        self._look_up()

    def _frame_changed(self, frame: int) -> None:
        self.panel.set_cursor(frame)
        self._mark(self.session.probe)

    def _mark(self, place: Target | None) -> None:
        """Show the place in both views: in the frame where it was chosen the outline, and its Gaussians in 3D at all times."""
        panel, splats = self.viewer.panel, self.viewer.splats
        panel.marks.set_marker((place.x, place.y) if isinstance(place, Spot) else None)
        panel.marks.set_outline(place.outline if isinstance(place, Region) and place.frame == self.session.frame else ())
        if place is None and splats is not None:
            splats.highlight(None)

    def _view_state_changed(self, before: ViewState, after: ViewState) -> None:
        place = self.session.probe
        if isinstance(place, Found) and place.prompt not in {prompt.text for prompt in after.visible_prompts}:
            self.session.probe = None
        elif place is not None and (before.prompts != after.prompts or (isinstance(place, Found) and _decides(before) != _decides(after))):
            self._follow(place)
        elif place is not None and before.layer != after.layer and self.curves is not None:
            known = after.layer in self.curves.layers or get_layer(after.layer).kind != "scalar"
            self._show_curves(self.curves) if known else self._follow(place)

    def _follow(self, place: Target) -> None:
        scene, view_state = self.session.scene, self.session.view_state
        assert scene is not None

        def progress(step: tuple[float, str]) -> None:
            self.panel.set_pinned(f"{place}: following it, {step[0]:.0%}")

        self.worker.submit("curves", lambda: follow(scene, place, view_state), self._show_curves, self.panel.set_pinned, progress)
        self._highlight(scene, place)

    def _highlight(self, scene: Scene, place: Target) -> None:
        """Mark the Gaussians of a place in the 3D view."""
        splats = self.viewer.splats
        if splats is None or isinstance(place, Found):
            return

        def failed(message: str) -> None:
            splats.highlight(None)

        self.worker.submit("material", lambda: material(scene, place)[0], splats.highlight, failed)

    def _show_curves(self, curves: Curves) -> None:
        probe, layer = self.panel, get_layer(self.session.view_state.layer).name
        self._clear_curves()
        self.curves = curves
        probe.set_pinned(curves.where)
        shown = layer if layer in curves.layers else "displacement"
        mean, low, high = curves.layers[shown]
        name = with_unit(shown, curves.units[shown])
        probe.plot.set_labels("frame", name)
        probe.plot.set_series(name, curves.frames, mean, probe.palette().text().color(), (low, high))
        for text, values in curves.similarity.items():
            probe.similarity.set_series(text, curves.frames, values, QColor(*self.session.view_state.prompt(text).colour))
        probe.similarity.setVisible(bool(curves.similarity))
        self.panel.set_cursor(self.session.frame)
        if not self.dock.isVisible():
            value = dict(means(curves, self.session.frame))[shown]
            self.shell.say(f"{get_layer(shown).title} here: {value}. Its course is in Curves, below.")
        self._show_values()
        self._guides.refresh()
        self.shell.refresh()

    # In 3D

    def measure_from(self) -> None:
        """Measure from the place that is followed to the one that is followed next, in every frame."""
        assert self.curves is not None
        self._start = self.curves.trail
        self._guides.show("length")
        self.shell.say("Click the other end; the length is shown in the 3D view.")

    def trail(self) -> list[Guide]:
        """The way of what is followed, in 3D."""
        trail = self.curves.trail if self.curves is not None else None
        return [Guide(trail, TRAIL)] if trail is not None and len(trail) > 1 else []

    def length(self) -> list[Guide]:
        """The line from the start of the length to what is followed, at this frame."""
        trail = self.curves.trail if self.curves is not None else None
        if self._start is None or trail is None or trail is self._start or self.session.scene is None:
            return []
        ends = np.stack([self._start, trail])[:, self.session.frame]
        return [Guide(ends, LENGTH, f"{np.linalg.norm(ends[1] - ends[0]):.3g} {self.session.scene.unit}")]

    def _clear_curves(self) -> None:
        self.curves = None
        self.panel.clear_curves()

    # Saving

    def save_curves(self, path: Path) -> None:
        """The curves as a table (`.csv`) or as the plots that are shown (`.png`).

        DegenseError when nothing is followed, or the file cannot be written.
        """
        if self.curves is None:
            raise DegenseError("Click in the 2D view first: there are no curves yet.")
        if path.suffix.lower() == ".csv":
            write_text(path, to_csv(self.curves))
        else:
            write_png(path, to_array(self.panel.plots.grab().toImage()))


def _decides(view_state: ViewState) -> tuple[float, str, tuple[str, ...]]:
    """What a mask depends on besides its prompt."""
    return view_state.threshold, view_state.decoder, view_state.negative_texts
