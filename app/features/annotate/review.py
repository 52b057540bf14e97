"""Propagating labels to all frames, and the review of what was proposed."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject

from degense.app.features.annotate.panel import AnnotationPanel
from degense.app.features.annotate.state import AnnotationState
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.annotation.edits import Proposal


class PropagationReview(QObject):
    """Propagates the labelled frames in the worker, and accepts or rejects the proposals."""

    def __init__(self, shell: Shell, state: AnnotationState, panel: AnnotationPanel) -> None:
        super().__init__(shell)
        self.shell, self.session, self.state, self.panel = shell, shell.session, state, panel
        self.session.opened.connect(self._opened)

    def propagate(self) -> None:
        """Propagate the frames that were edited by hand, and this one, to all others."""
        work, clip, scene = self.state.ready(), self.session.clip, self.session.scene
        if clip is None:
            raise DegenseError(f"Propagating labels needs the recording, which is missing: {scene.clip_missing if scene else ''}")
        sources = {frame: work.labels(frame) for frame in work.sources(self.session.frame)}
        if not sources:
            raise DegenseError("No frame is labelled yet; paint one, and its labels can be propagated to the others.")

        def steps() -> Generator[tuple[float, str], None, dict[int, Proposal]]:
            from degense.engine.annotation.propagation.propagate import propagate

            return propagate(clip, sources, scene)

        def progress(step: tuple[float, str]) -> None:
            self.panel.set_progress(step[0])
            self.shell.set_busy(step[1][0].upper() + step[1][1:], step[0])

        def done(proposals: dict[int, Proposal]) -> None:
            self._ended()
            self.state.propose(proposals)
            more = "" if self.state.ready().next_flagged(-1) is None else " Next flagged goes to the doubtful ones."
            self.shell.say(f"Propagated to {len(proposals)} frames: accept or reject them.{more}", 20)

        def failed(message: str) -> None:
            self._ended()
            self.shell.show_error(message)

        self.panel.set_progress(0.0)
        self.shell.submit("annotate", steps, done, failed, progress)
        self.shell.refresh()

    def stop(self) -> None:
        """Stop propagating; nothing of it is proposed."""
        self.shell.worker.cancel("annotate")
        self._ended()
        self.shell.say("Stopped; no frame was changed.")

    def answer(self, answer: Callable[[Sequence[int]], None], all_frames: bool = False) -> None:
        """Accept or reject (a method of the state) the proposal for the frame that is shown, or all proposals."""
        answer(self.state.ready().waiting() if all_frames else [self.session.frame])

    def go_to_flagged(self) -> None:
        """Go to the next frame that is flagged or of which the proposal is doubtful."""
        frame = self.state.work.next_flagged(self.session.frame) if self.state.work else None
        if frame is None:
            self.shell.say("No frame is flagged or doubtful.")
        else:
            self.session.pause()
            self.session.go_to(frame)

    def _ended(self) -> None:
        self.shell.set_busy()
        self.panel.set_progress(None)
        self.shell.refresh()

    def _opened(self) -> None:
        self.shell.worker.cancel("annotate")
        self.panel.set_progress(None)
