"""Propagating labels to all frames, and the review of what was proposed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QMessageBox

from degense.app.features.annotate.state import AnnotationState
from degense.app.shell.messages import Choice
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps

if TYPE_CHECKING:
    import numpy as np

    from degense.engine.annotation.edits import Proposal
    from degense.engine.clip import Clip


class PropagationReview(QObject):
    """Propagates the labelled frames in the worker, and accepts or rejects the proposals."""

    def __init__(self, shell: Shell, state: AnnotationState) -> None:
        super().__init__(shell)
        self.shell, self.session, self.state = shell, shell.session, state
        self.session.opened.connect(lambda: shell.worker.cancel("annotate"))

    def propagate(self) -> None:
        """Propagate the frames edited by hand, and this one, to all others; those that have labels keep them unless told otherwise."""
        work, clip, scene = self.state.ready(), self.session.clip, self.session.scene
        if clip is None:
            raise DegenseError(f"Propagating labels needs the recording, which is missing: {scene.clip_missing if scene else ''}")
        sources = {frame: work.reader(frame) for frame in work.sources(self.session.frame)}
        if not sources:
            raise DegenseError("No frame is labelled yet; paint one, and its labels can be propagated to the others.")
        made = {frame for frame, record in work.records.items() if record.labels is not None}
        kept = made.union(clip.labelled_frames).difference(sources)
        if not kept:
            self._propagate(clip, sources)
            return
        keep = Choice("Keep them", lambda: self._propagate(clip, sources), default=True)
        self.shell.ask(
            "labelled frames",
            f"{len(kept)} of the other frames have labels already.",
            *((keep,) if len(kept) + len(sources) < work.count else ()),
            Choice("Propose new ones", lambda: self._propagate(clip, sources, replacing=True)),
            Choice("Cancel", escape=True),
            details="A new proposal that you accept replaces the labels of its frame. Frames that were painted by hand are always kept.",
            icon=QMessageBox.Icon.Question,
        )

    def _propagate(self, clip: Clip, sources: dict[int, Callable[[], np.ndarray]], replacing: bool = False) -> None:
        scene = self.session.scene

        def steps() -> Steps[dict[int, Proposal]]:
            from degense.engine.annotation.propagation.propagate import propagate

            return propagate(clip, {frame: read() for frame, read in sources.items()}, scene)

        def done(proposals: dict[int, Proposal]) -> None:
            self.state.propose(proposals, replacing)
            work = self.state.ready()
            more = " N goes to the doubtful ones." if work.review_queue() else ""
            self.shell.say(f"Propagated to {len(work.waiting())} frames: accept or reject them.{more}", 20)

        self.shell.run_task("annotate", "Propagating labels", steps, done, detailed=True)
        self.shell.refresh()

    def stop(self) -> None:
        """Stop propagating; nothing of it is proposed."""
        self.shell.worker.cancel("annotate")
        self.shell.set_busy()
        self.shell.refresh()
        self.shell.say("Stopped; no frame was changed.")

    def answer(self, answer: Callable[[Sequence[int]], None], all_frames: bool = False) -> None:
        """Accept or reject (a method of the state) the proposal for the frame that is shown, or all proposals."""
        answer(self.state.ready().waiting() if all_frames else [self.session.frame])

    def go_on(self, step: int) -> None:
        """Go to the next or the previous frame that is flagged or of which the proposal is doubtful, the most doubtful first."""
        frame = self.state.work.next_in_queue(self.session.frame, step) if self.state.work else None
        if frame is None:
            self.shell.say("No frame is flagged or doubtful.")
        else:
            self.session.pause()
            self.session.go_to(frame)
