"""The frames that ask to be looked at, the most doubtful first, and how often each class is labelled."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from PySide6.QtWidgets import QHeaderView, QWidget

from degense.app.features.annotate.label_sets import counted
from degense.app.features.annotate.state import AnnotationState
from degense.app.shell.shell import Shell
from degense.engine.annotation.annotations import Record
from degense.engine.annotation.statistics import class_counts, pixel_counts
from degense.engine.progress import Steps
from degense.widgets import forms
from degense.widgets.elided import ElidedLabel
from degense.widgets.keys import ARROWS, keep_keys


class ReviewQueue:
    """A table of doubtful frames; choosing a row goes to its frame."""

    def __init__(self, state: AnnotationState) -> None:
        self.state = state
        self.table = forms.table("Doubtful frames", ["Frame", "Doubt", "Why"])
        for column in (0, 1):
            self.table.horizontalHeader().setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        self.table.currentCellChanged.connect(lambda row, *_: self._go(row))
        keep_keys(self.table, ARROWS)

    def show(self, frame: int) -> None:
        """List the queue; the row of the frame that is shown is marked."""
        work = self.state.work
        queue = work.review_queue() if work is not None else []
        rows = [(str(index), f"{work.doubt(index):.0%}", _why(work.record(index))) for index in queue] if work is not None else []
        blocked = self.table.blockSignals(True)
        forms.fill(self.table, rows)
        self.table.setCurrentCell(queue.index(frame) if frame in queue else -1, 0)
        self.table.blockSignals(blocked)

    def _go(self, row: int) -> None:
        queue = self.state.work.review_queue() if self.state.work is not None else []
        if 0 <= row < len(queue):
            self.state.session.pause()
            self.state.session.go_to(queue[row])


def _why(record: Record) -> str:
    reasons = ["flagged"] if record.status == "flagged" else []
    if record.proposal is not None:
        reasons.append(f"confidence {record.proposal.confidence:.0%}")
        if record.proposal.unknown:
            reasons.append(f"{record.proposal.unknown:.1%} of it unknown")
    return ", ".join(reasons)


class ClassStatistics(QWidget):
    """Frames, pixels and share of each class, counted in the worker while the page is seen; only frames that changed are counted again."""

    def __init__(self, shell: Shell, state: AnnotationState) -> None:
        super().__init__()
        self.shell, self.state = shell, state
        self.table = forms.table("Statistics of the classes", ["Class", "Frames", "Pixels", "Share"])
        for column in (1, 2, 3):
            self.table.horizontalHeader().setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        self.total = ElidedLabel("Labelled frames", secondary=True)
        forms.column(self.table, self.total, parent=self)
        self._counts: dict[int, tuple[object, np.ndarray]] = {}
        shell.worker.add_channel("label statistics", 61)
        state.records_changed.connect(self.refresh)
        state.classes_changed.connect(self.refresh)
        shell.session.opened.connect(self._forget)

    def _forget(self) -> None:
        self.shell.worker.cancel("label statistics")
        self._counts = {}
        self.refresh()

    def showEvent(self, event: object) -> None:
        super().showEvent(event)  # type: ignore[arg-type]
        self.refresh()

    def refresh(self) -> None:
        """Count what has changed since it was counted last."""
        work = self.state.work
        if work is None or not self.isVisible():
            return
        marks = {frame: work.record(frame).labels for frame in self.state.labelled_frames()}
        self._counts = {frame: kept for frame, kept in self._counts.items() if frame in marks and kept[0] is marks[frame]}
        readers = {frame: (marks[frame], work.reader(frame)) for frame in marks if frame not in self._counts}
        self._show()
        if readers:
            self.shell.submit("label statistics", lambda: _count(readers), self._take, self.total.setText)

    def _take(self, counts: dict[int, tuple[object, np.ndarray]]) -> None:
        self._counts |= counts
        self._show()

    def _show(self) -> None:
        work = self.state.work
        if work is None:
            return
        found = class_counts({frame: counts for frame, (_, counts) in self._counts.items()}, len(work.classes))
        rows = [
            (kind.title, str(count.frames), f"{count.pixels:,}", f"{count.share:.1%}")
            for kind, count in zip(work.classes, found, strict=True)
        ]
        forms.fill(self.table, rows)
        size = work.shape[0] * work.shape[1] * max(1, len(self._counts))
        labelled = sum(count.pixels for count in found) / size
        self.total.setText(f"{counted(len(self._counts), 'labelled frame')}; {labelled:.1%} of their pixels are labelled")
        self.total.setToolTip(self.total.text())


def _count(readers: Mapping[int, tuple[object, Callable[[], np.ndarray]]]) -> Steps[dict[int, tuple[object, np.ndarray]]]:
    found = {}
    for done, (frame, (mark, read)) in enumerate(readers.items()):
        yield done / len(readers), f"frame {frame}"
        found[frame] = mark, pixel_counts(read())
    return found
