"""Statistics of the prompts in the window: area, confidence and similarities in the bar, areas over time under the timeline."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QTimer
from PySide6.QtGui import QColor

from degense.app.features.prompts.mask_statistics import AreaCurves, MaskStatistics, areas, measure_masks
from degense.app.features.prompts.panel import PromptBar
from degense.app.features.timeline.controller import TimeControl
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.view_rendering import View
from degense.app.session.view_state import ViewState

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: The areas of other frames are computed when nothing was drawn for so long, milliseconds: so that scrubbing does not wait for them.
QUIET_MS = 700


class PromptStatistics(QObject):
    """After each view computes the statistics of its frame, and when nothing changes any more the areas in the other frames."""

    def __init__(self, viewer: Viewer, bar: PromptBar) -> None:
        super().__init__(viewer)
        self.shell, self.session, self.worker, self.bar = viewer.shell, viewer.session, viewer.worker, bar
        session = self.session
        self.areas = AreaCurves()
        session.register("areas", self.areas)
        self._quiet = QTimer(self, singleShot=True, interval=QUIET_MS)
        self._quiet.timeout.connect(self._compute_areas)
        viewer.shown.connect(self._drawn)
        session.view_state_changed.connect(self._view_state_changed)
        session.frame_changed.connect(lambda frame: self._wait())
        session.opened.connect(self._opened)

    def _opened(self) -> None:
        self.worker.cancel("answers")
        self._wait()
        self._show_strips()
        self._show_answers(())

    def _view_state_changed(self, before: ViewState, after: ViewState) -> None:
        self._wait()
        self._show_strips()

    def _wait(self) -> None:
        self.worker.cancel("areas")
        self._quiet.start()

    def _drawn(self, view: View) -> None:
        scene, view_state = self.session.scene, self.session.view_state
        if scene is None or not scene.has_semantics or self.session.playing or not view_state.visible_prompts:
            self._show_answers(())
            return
        frame = round(view.frame)
        self.worker.submit(
            "answers", lambda: measure_masks(scene, frame, view_state), self._show_answers, self.shell.say, self._show_answers
        )

    def _show_answers(self, known: tuple[MaskStatistics, ...]) -> None:
        bar, view_state = self.bar, self.session.view_state
        by_text = {answer.text.casefold(): answer for answer in known}
        for row in bar.prompts():
            answer = by_text.get(row.text.casefold())
            row.set_answer(*((answer.area, answer.confidence) if answer is not None else (None, None)))
        shown = [(answer, prompt) for prompt in view_state.visible_prompts if (answer := by_text.get(prompt.text.casefold())) is not None]
        bar.histogram.set_curves([(answer.histogram, QColor(*prompt.colour)) for answer, prompt in shown])

    # Over time

    def _compute_areas(self) -> None:
        scene, view_state = self.session.scene, self.session.view_state
        if scene is None or not scene.has_semantics or self.session.playing or not view_state.visible_prompts:
            return
        if self.worker.busy("query"):  # the whole clip is being asked already
            self._quiet.start()
            return
        wanted = self.areas.missing(view_state, scene.frames, self.session.frame)
        if not wanted:
            return

        def found(step: tuple[int, dict[str, float]]) -> None:
            self.take(scene, view_state, *step)

        self.worker.submit("areas", lambda: areas(scene, view_state, wanted), lambda result: self._show_strips(), self.shell.say, found)

    def take(self, scene: Scene, view_state: ViewState, frame: int, found: dict[str, float]) -> None:
        """Keep the areas of a frame, and show them."""
        for text, area in found.items():
            self.areas.curve(text, view_state, scene.frames)[frame] = area
        self._show_strips()

    def _show_strips(self) -> None:
        """The areas of the visible prompts under the timeline."""
        scene, view_state, time = self.session.scene, self.session.view_state, self.shell.service(TimeControl)
        if time is None:
            return
        strips = {}
        if scene is not None and scene.has_semantics and time.timeline.count() == scene.frames:
            for prompt in view_state.visible_prompts:
                strips[prompt.text] = self.areas.curve(prompt.text, view_state, scene.frames), QColor(*prompt.colour)
        time.timeline.track.set_strips(strips)
