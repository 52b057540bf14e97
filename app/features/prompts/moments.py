"""The moments that answer the questions among the prompts: found in the worker, listed, and gone to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QHeaderView, QWidget

from degense.app.features.viewer.controller import Viewer
from degense.app.session.view_state import ViewState
from degense.widgets import forms
from degense.widgets.keys import ARROWS, keep_keys

if TYPE_CHECKING:
    from degense.engine.scene.moments import Answer, Moment
    from degense.engine.semantics.prompts import PromptSet

#: The worker's channel.
MOMENTS = "moments"
#: The clip is asked when nothing was changed for so long, milliseconds: so that a threshold can be dragged.
QUIET_MS = 400
HINT = "Ask when something happens: type a question such as “grasper touching liver” as a prompt."


class MomentList(QObject):
    """Asks the whole clip whenever the questions or how masks are decided has changed; a row that is chosen goes to its frame."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.shell, self.session, self.worker = viewer.shell, viewer.session, viewer.worker
        self.answers: tuple[Answer, ...] = ()
        self._asked: PromptSet | None = None
        self._brought: tuple[str, ...] = ()  # the questions for which the list came to the front
        panel = QWidget()
        panel.setAccessibleName("Moments")
        self._note = forms.label(HINT, secondary=True)
        self.table = forms.table("Moments", ["Question", "Frames", "Time [s]", "Largest"])
        for column in (1, 2, 3):
            self.table.horizontalHeader().setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        self.table.currentCellChanged.connect(lambda row, *_: self._go(row) if row >= 0 else None)
        self.table.cellActivated.connect(lambda row, *_: self._go(row))
        keep_keys(self.table, ARROWS)
        forms.column(self._note, (self.table, 1), parent=panel)
        self.dock = self.shell.add_dock("Moments", panel)
        self._quiet = QTimer(self, singleShot=True, interval=QUIET_MS)
        self._quiet.timeout.connect(self._ask)
        self.session.view_state_changed.connect(lambda before, after: self._changed(after))
        self.session.opened.connect(lambda: self._changed(self.session.view_state))

    def moments(self) -> list[tuple[Answer, Moment]]:
        """What is listed."""
        return [(answer, moment) for answer in self.answers for moment in answer.moments]

    def listed(self) -> bool:
        return bool(self.moments())

    def go_on(self, step: int) -> None:
        """To the next moment, or back, round and round."""
        if count := self.table.rowCount():
            before = self.table.currentRow()
            row = (before + step) % count if before >= 0 else 0
            self.table.setCurrentCell(row, 0)
            if row == before:
                self._go(row)

    def _changed(self, view_state: ViewState) -> None:
        """Ask anew where the questions are others than those that were answered."""
        asked = self._questions(view_state)
        if asked == self._asked:
            return
        self._asked = asked
        self.worker.cancel(MOMENTS)
        self._show((), HINT)
        if asked is not None:
            self._quiet.start()

    def _questions(self, view_state: ViewState) -> PromptSet | None:
        """The questions among the visible prompts; None without any, or a scene to answer them."""
        from dataclasses import replace

        scene = self.session.scene
        if scene is None or not scene.has_semantics:
            return None
        questions = tuple(prompt.text for prompt in view_state.visible_prompts if not scene.question(prompt.text).plain)
        return replace(view_state.prompt_set, prompts=questions) if questions else None

    def _ask(self) -> None:
        from degense.engine.scene.moments import ask_clip

        scene, asked = self.session.scene, self._asked
        if scene is None or asked is None:
            return

        def progress(step: tuple[float, str]) -> None:
            self._note.setText(f"Looking through the clip, {step[0]:.0%}")

        def found(answers: tuple[Answer, ...]) -> None:
            self._show(answers, "; ".join(_in_words(answer) for answer in answers))
            if asked.prompts != self._brought:  # not again while a threshold is dragged
                self._brought = asked.prompts
                self.shell.docks.bring(self.dock)

        self.worker.submit(MOMENTS, lambda: ask_clip(scene, asked), found, self._note.setText, progress)

    def _show(self, answers: tuple[Answer, ...], note: str) -> None:
        self.answers = answers
        self._note.setText(note)
        fps = self.session.scene.fps if self.session.scene is not None else 1.0
        rows = [
            (answer.text, _span(m.first, m.last, ""), _span(m.first / fps, m.last / fps, ".2f"), f"{m.area:.1%}")
            for answer, m in self.moments()
        ]
        self.table.setCurrentCell(-1, -1)
        forms.fill(self.table, rows)
        self.shell.refresh()

    def _go(self, row: int) -> None:
        self.session.pause()
        self.session.go_to(self.moments()[row][1].first)


def _span(first: float, last: float, form: str) -> str:
    return f"{first:{form}}" if first == last else f"{first:{form}}–{last:{form}}"


def _in_words(answer: Answer) -> str:
    """ "grasper touching liver: 2 moments, 12 of 40 frames"."""
    count = len(answer.moments)
    return f"{answer.text}: {count} moment{'s' * (count != 1)}, {answer.kept.sum()} of {len(answer.kept)} frames"
