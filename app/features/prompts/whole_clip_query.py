"""Query of the whole clip: areas of the prompts under the timeline, or masks in a folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject

from degense.app.features.prompts.mask_statistics import areas
from degense.app.features.prompts.prompt_statistics import PromptStatistics
from degense.app.features.prompts.segment import write_clip_masks
from degense.app.shell.shell import Shell

CHANNEL = "query"


class ClipQuery(QObject):
    """Runs in the worker; what was computed stays when it is stopped."""

    def __init__(self, shell: Shell, statistics: PromptStatistics) -> None:
        super().__init__(shell)
        self.shell, self.session, self.worker, self.statistics = shell, shell.session, shell.worker, statistics
        self.session.opened.connect(self._opened)

    @property
    def running(self) -> bool:
        return self.worker.busy(CHANNEL)

    def can_ask(self) -> bool:
        """Whether there are visible prompts and a scene with semantics."""
        scene = self.session.scene
        return scene is not None and scene.has_semantics and bool(self.session.view_state.visible_prompts) and not self.running

    def ask(self) -> None:
        """Compute the areas of the visible prompts in all frames where they are not known, from this one outwards."""
        scene, view_state = self.session.scene, self.session.view_state
        assert scene is not None
        frames = self.statistics.areas.missing(view_state, scene.frames, self.session.frame)
        known = scene.frames - len(frames)

        def found(step: tuple[int, dict[str, float]]) -> None:
            nonlocal known
            known += 1
            self.statistics.take(scene, view_state, *step)
            self.shell.set_busy("Querying the whole clip", known / scene.frames)

        def done(result: object) -> None:
            curves = {
                prompt.text: self.statistics.areas.curve(prompt.text, view_state, scene.frames) for prompt in view_state.visible_prompts
            }
            self._end("The whole clip: " + "; ".join(_in_words(text, values) for text, values in curves.items()))

        self.worker.cancel("areas")  # it would compute the same frames
        self.shell.set_busy("Querying the whole clip", 0.0)
        self.worker.submit(CHANNEL, lambda: areas(scene, view_state, frames), done, self._failed, found)
        self.shell.refresh()

    def ask_for_folder(self) -> None:
        if (folder := self.shell.ask_folder("Folder for the masks of the whole clip")) is not None:
            self.save(folder)

    def save(self, folder: Path) -> None:
        """Write label maps, masks and areas of the visible prompts into a folder, or go on with it (`degense segment --frames all`)."""
        scene, prompts = self.session.scene, self.session.view_state.prompt_set
        assert scene is not None

        self.shell.run_task(
            CHANNEL,
            f"Writing masks into {folder.name}",
            lambda: write_clip_masks(scene, prompts, range(scene.frames), folder),
            lambda areas: self._end(f"{folder}: masks of {scene.frames} frames"),
        )
        self.shell.refresh()

    def stop(self) -> None:
        self.worker.cancel(CHANNEL)
        self._end("Stopped; what was found so far is kept.")

    def _opened(self) -> None:
        if self.running:
            self.stop()

    def _end(self, text: str) -> None:
        self.shell.set_busy()
        self.shell.say(text)
        self.shell.refresh()

    def _failed(self, message: str) -> None:
        self.shell.set_busy()
        self.shell.refresh()
        self.shell.show_error(message)


def _in_words(text: str, areas: np.ndarray) -> str:
    """ "liver in 38 of 40 frames, 21.4 % of the frame at most"."""
    return f"{text} in {int((areas > 0).sum())} of {len(areas)} frames, {areas.max():.1%} of the frame at most"
