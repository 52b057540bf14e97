"""Statistics of the prompts in the window: of the frame in the bar, areas over time in the drawer, and the query of the whole clip."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, QTimer
from PySide6.QtGui import QColor

from degense.app.features.prompts.area_panel import AreaPanel
from degense.app.features.prompts.mask_statistics import AreaCurves, MaskStatistics, areas, measure_masks
from degense.app.features.prompts.panel import PromptBar
from degense.app.features.prompts.segment import write_clip_masks
from degense.app.features.timeline.controller import TimeControl
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.view_rendering import View
from degense.app.session.view_state import ViewState

if TYPE_CHECKING:
    from degense.engine.scene import Scene

Action = Callable[[], None]
#: The worker's channel of queries.
QUERY = "query"
#: The areas of other frames are computed when nothing was drawn for so long, milliseconds: so that scrubbing does not wait for them.
QUIET_MS = 700


class PromptStatistics(QObject):
    """After each view computes the statistics of its frame, and when nothing changes any more the areas in the other frames.

    A query of the whole clip computes these at once, or writes the masks; what was computed stays when it is stopped.
    """

    def __init__(self, viewer: Viewer, bar: PromptBar) -> None:
        super().__init__(viewer)
        self.shell, self.session, self.worker, self.bar, self.pacing = viewer.shell, viewer.session, viewer.worker, bar, viewer.pacing
        session = self.session
        self.areas = AreaCurves()
        session.register("areas", self.areas)
        self.area_panel = AreaPanel()
        self.shell.add_dock("Areas", self.area_panel)
        self.area_panel.frame_clicked.connect(session.go_to)
        self._quiet = QTimer(self, singleShot=True, interval=QUIET_MS)
        self._quiet.timeout.connect(self._compute_areas)
        viewer.shown.connect(self._drawn)
        session.view_state_changed.connect(self._view_state_changed)
        session.frame_changed.connect(self._frame_changed)
        session.opened.connect(self._opened)

    def _opened(self) -> None:
        if self.running:
            self.stop()
        self.worker.cancel("answers")
        self._wait()
        self._show_strips()
        self._show_answers(())

    def _view_state_changed(self, before: ViewState, after: ViewState) -> None:
        self._wait()
        self._show_strips()

    def _frame_changed(self, frame: int) -> None:
        self.area_panel.plot.set_cursor(frame)
        self._wait()

    def _wait(self) -> None:
        self.worker.cancel("areas")
        self._quiet.start()

    def _drawn(self, view: View) -> None:
        scene, view_state = self._asked()
        if scene is None or self.pacing.quick:
            self._show_answers(())
            return
        frame = round(view.frame)
        self.worker.submit(
            "answers", lambda: measure_masks(scene, frame, view_state), self._show_answers, self.shell.say, self._show_answers
        )

    def _asked(self) -> tuple[Scene | None, ViewState]:
        """The scene, where it answers prompts and there are some, and how they are asked."""
        scene, view_state = self.session.scene, self.session.view_state
        return (scene if scene is not None and scene.has_semantics and view_state.visible_prompts else None), view_state

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
        scene, view_state = self._asked()
        if scene is None or self.session.playing:
            return
        if self.running:  # the whole clip is being asked already
            self._quiet.start()
        elif wanted := self.areas.missing(view_state, scene.frames, self.session.frame):
            self._submit("areas", scene, wanted, self._show_strips, self.shell.say)

    def _submit(
        self, channel: str, scene: Scene, frames: list[int], done: Action, failed: Callable[[str], None], progress: Action = lambda: None
    ) -> None:
        """Compute, keep and show the areas in some frames."""
        view_state = self.session.view_state

        def found(step: tuple[int, dict[str, float]]) -> None:
            frame, shares = step
            for text, area in shares.items():
                self.areas.curve(text, view_state, scene.frames)[frame] = area
            self._show_strips()
            progress()

        self.worker.submit(channel, lambda: areas(scene, view_state, frames), lambda result: done(), failed, found)

    def _show_strips(self) -> None:
        """The areas of the visible prompts, in the drawer and small under the timeline."""
        scene, view_state = self._asked()
        curves = {}
        if scene is not None:
            for prompt in view_state.visible_prompts:
                curves[prompt.text] = self.areas.curve(prompt.text, view_state, scene.frames), QColor(*prompt.colour)
        self.area_panel.set_curves(curves)
        time = self.shell.service(TimeControl)
        if time is not None:
            time.timeline.track.set_strips(curves if scene is not None and time.timeline.count() == scene.frames else {})

    # The query of the whole clip

    @property
    def running(self) -> bool:
        return self.worker.busy(QUERY)

    def can_ask(self) -> bool:
        """Whether there are visible prompts and a scene with semantics."""
        return self._asked()[0] is not None and not self.running

    def ask(self) -> None:
        """Compute the areas of the visible prompts in all frames where they are not known, from this one outwards."""
        scene, view_state = self.session.scene, self.session.view_state
        assert scene is not None
        frames = self.areas.missing(view_state, scene.frames, self.session.frame)
        known = scene.frames - len(frames)

        def progress() -> None:
            nonlocal known
            known += 1
            self.shell.set_busy("Querying the whole clip", known / scene.frames)

        def done() -> None:
            texts = [prompt.text for prompt in view_state.visible_prompts]
            words = [_in_words(text, self.areas.curve(text, view_state, scene.frames)) for text in texts]
            self._end(f"The whole clip: {'; '.join(words)}")

        def failed(message: str) -> None:
            self._end("")
            self.shell.show_error(message)

        self.worker.cancel("areas")  # it would compute the same frames
        self.shell.set_busy("Querying the whole clip", 0.0)
        self._submit(QUERY, scene, frames, done, failed, progress)
        self.shell.refresh()

    def ask_for_folder(self) -> None:
        if (folder := self.shell.ask_folder("Folder for the masks of the whole clip")) is not None:
            self.save(folder)

    def save(self, folder: Path) -> None:
        """Write label maps, masks and areas of the visible prompts into a folder, or go on with it (`degense segment --frames all`)."""
        scene, prompts = self.session.scene, self.session.view_state.prompt_set
        assert scene is not None

        self.shell.run_task(
            QUERY,
            f"Writing masks into {folder.name}",
            lambda: write_clip_masks(scene, prompts, range(scene.frames), folder),
            lambda areas: self._end(f"{folder}: masks of {scene.frames} frames"),
        )
        self.shell.refresh()

    def stop(self) -> None:
        self.worker.cancel(QUERY)
        self._end("Stopped; what was found so far is kept.")

    def _end(self, text: str) -> None:
        self.shell.set_busy()
        self.shell.say(text)
        self.shell.refresh()


def _in_words(text: str, areas: np.ndarray) -> str:
    """ "liver in 38 of 40 frames, 21.4 % of the frame at most"."""
    return f"{text} in {int((areas > 0).sum())} of {len(areas)} frames, {areas.max():.1%} of the frame at most"
