"""Values under the cursor, and the curves of the spot that was clicked."""

from __future__ import annotations

from PySide6.QtCore import QObject
from PySide6.QtGui import QColor

from app.look import Look
from app.probe import Curves, ProbeMaps, follow, probe_maps
from app.render_service import RenderService
from app.session import Session
from app.view import View
from app.window.drawing import Drawing
from app.window.parts import Parts


class Probing(QObject):
    """Hovering looks values up in maps that are drawn once a frame; clicking follows a spot through time."""

    def __init__(self, session: Session, service: RenderService, parts: Parts, drawing: Drawing) -> None:
        super().__init__(parts)
        self.session, self.service, self.parts, self.drawing = session, service, parts, drawing
        self._maps: ProbeMaps | None = None
        self._cursor: tuple[int, int] | None = None
        self._origin = 0
        self.curves: Curves | None = None
        parts.panel.hovered.connect(self._hovered)
        parts.panel.clicked.connect(self._clicked)
        parts.probe.unpin_requested.connect(lambda: self._pin(None))
        parts.probe.frame_clicked.connect(session.go_to)
        drawing.shown.connect(self._drawn)
        session.opened.connect(self._opened)
        session.probe_changed.connect(self._probe_changed)
        session.look_changed.connect(self._look_changed)
        session.frame_changed.connect(self._set_cursor)
        parts.similarity.x_clicked.connect(lambda x: session.go_to(round(x)))

    def use_splat_view(self) -> None:
        """The 3D view is there now: a click on a splat is a click on the spot that the surgeon sees there."""
        assert self.parts.splats is not None
        self.parts.splats.picked.connect(self._picked)

    def _opened(self) -> None:
        self._maps = self._cursor = None
        self.service.cancel("probe")
        self.service.cancel("curves")
        self.parts.probe.clear()
        self._clear_curves()
        self.parts.panel.clear_marker()

    # Hovering

    def _hovered(self, x: int, y: int) -> None:
        self._cursor = (x, y) if x >= 0 else None
        self._draw_maps()
        self._show_values()

    def _drawn(self, view: View) -> None:
        self._draw_maps()
        self._show_values()

    def _draw_maps(self) -> None:
        """Ask for the maps of this frame when they will be looked at, and nothing is moving."""
        scene, frame = self.session.scene, self.session.frame
        wanted = scene is not None and not self.session.playing and (self._cursor or self.session.probe)
        if not wanted or (self._maps is not None and self._maps.frame == frame):
            return
        assert scene is not None
        self._maps = None
        self.service.submit("probe", lambda: probe_maps(scene, frame), self._take_maps, self.parts.say, self._take_maps)

    def _take_maps(self, maps: ProbeMaps) -> None:
        if maps.frame == self.session.frame:
            self._maps = maps
            self._show_values()

    def _show_values(self) -> None:
        at = self._cursor or self.session.probe
        maps = self._maps
        if at is None or maps is None or maps.frame != self.session.frame:
            return
        x, y = int(at[0]), int(at[1])
        if 0 <= y < maps.rgb.shape[0] and 0 <= x < maps.rgb.shape[1]:
            self.parts.probe.set_values(maps.rows(x, y))
            self.parts.probe.set_colour(QColor(*maps.colour(x, y)))

    # Clicking

    def _clicked(self, x: int, y: int) -> None:
        if self.session.scene is not None:
            self._pin((x + 0.5, y + 0.5))

    def _picked(self, index: int) -> None:
        view = self.drawing.view
        if index >= 0 and view is not None and view.splats is not None:
            pixel, depth = view.camera.project(view.splats.means[index].astype(float))
            if depth > 0 and 0 <= pixel[0] < view.camera.width and 0 <= pixel[1] < view.camera.height:
                self._pin((float(pixel[0]), float(pixel[1])))
            else:
                self.parts.say("The surgeon's camera does not see this spot.")

    def _pin(self, pixel: tuple[float, float] | None) -> None:
        self._origin = self.session.frame
        self.session.probe = pixel

    def _probe_changed(self, pixel: tuple[float, float] | None) -> None:
        parts = self.parts
        self._clear_curves()
        if pixel is None:
            self.service.cancel("curves")
            parts.panel.clear_marker()
            parts.probe.set_pinned("")
            return
        parts.panel.set_marker(*pixel)
        parts.probe_dock.raise_()
        self._follow(pixel)
        self._draw_maps()

    def _look_changed(self, before: Look, after: Look) -> None:
        if self.session.probe is not None and before.prompts != after.prompts:
            self._follow(self.session.probe)

    def _follow(self, pixel: tuple[float, float]) -> None:
        scene, origin = self.session.scene, self._origin
        assert scene is not None
        prompts = tuple(prompt.text for prompt in self.session.look.visible_prompts)
        where = f"spot at ({pixel[0]:.0f}, {pixel[1]:.0f}) of frame {origin}"

        def progress(step: tuple[float, str]) -> None:
            self.parts.probe.set_pinned(f"{where}: following it, {step[0]:.0%}")

        def failed(message: str) -> None:
            self.parts.probe.set_pinned(message)

        self.service.submit("curves", lambda: follow(scene, origin, *pixel, prompts), self._show_curves, failed, progress)

    def _show_curves(self, curves: Curves) -> None:
        probe = self.parts.probe
        self.curves = curves
        probe.set_pinned(curves.where)
        self._clear_curves()
        probe.set_curve("displacement", curves.frames, curves.displacement, probe.palette().text().color(), unit=curves.unit)
        for text, values in curves.similarity.items():
            self.parts.similarity.set_series(text, curves.frames, values, QColor(*self.session.look.prompt(text).colour))
        self.parts.similarity.setVisible(bool(curves.similarity))
        self._set_cursor(self.session.frame)

    def _clear_curves(self) -> None:
        self.parts.probe.clear_curves()
        self.parts.similarity.clear()
        self.parts.similarity.hide()

    def _set_cursor(self, frame: int) -> None:
        self.parts.probe.set_cursor(frame)
        self.parts.similarity.set_cursor(frame)
