"""The label maps of what is open, with undo and journal: the state that annotating changes. No Qt."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.app.features.annotate.label_sets import annotated, open_annotations
from degense.app.features.annotate.tool import PaintTool
from degense.app.session.state import PersistentState, Signal, Storing
from degense.engine.annotation.annotations import Annotations, Stroke
from degense.engine.annotation.edits import (
    LabelClass,
    LabelEdit,
    Piece,
    Proposal,
    State,
    Status,
    check_classes,
    default_colour,
    merged,
    pack,
    unpack,
)
from degense.engine.annotation.folder import NAME, save
from degense.engine.annotation.painting import PixelRegion
from degense.engine.errors import DegenseError, RunError, what_is_wrong

if TYPE_CHECKING:
    from degense.app.session.session import Session
    from degense.engine.annotation.formats import MapSet
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene

#: Seconds between two records of one stroke in the journal: what a crash loses of it at most.
STROKE_SECONDS = 1.0


class AnnotationState(PersistentState):
    """Label maps with undo and journal, and the tool that paints them.

    Those of a run lie in `annotations` in its folder, those of a clip without a run in the folder of its session.
    """

    def __init__(self, session: Session) -> None:
        super().__init__()
        self.session, self.tool = session, PaintTool()
        self.pixels_changed: Signal[[int, PixelRegion | None]] = Signal()  # (frame, region) that are shown; None is the whole frame
        self.records_changed: Signal[[]] = Signal()  # status, proposals, or which frames are labelled
        self.classes_changed: Signal[[]] = Signal()
        self.clear()

    # Persistence

    def clear(self) -> None:
        self.work: Annotations | None = None  # None while nothing is open, or where `blocked` says why
        self.folder: Path | None = None  # where the label maps are saved
        self.blocked = ""  # why the annotations of a clip cannot be opened; they are left alone then
        self._stroke: Stroke | None = None
        self._written, self._unwritten = -math.inf, False
        self._edits = self._stored = 0  # how often the label maps were changed, and of these how often when they were stored
        self.tool.clear()

    def to_json(self) -> Any:
        return self.tool.to_json()

    def from_json(self, data: Any, source: str) -> None:
        self.tool.from_json(data, source)

    def read(self, folder: Path, scene: Scene | None, clip: Clip | None) -> Callable[[], None]:
        place, work, blocked = _place(folder, scene), None, ""
        try:
            work = open_annotations(place, scene, clip)
        except DegenseError as error:
            if scene is not None:
                raise
            blocked = str(error)  # the clip can still be watched and trained on

        def take() -> None:
            self.folder, self.work, self.blocked = place, work, blocked

        return take

    def storing(self, folder: Path) -> Storing | None:
        self._unwritten = self._stroke is not None  # the journal, which is emptied now, held what the stroke has painted so far
        place, work, edits = _place(folder, self.session.scene), self.work, self._edits
        if work is None or (edits == self._stored and place == self.folder):
            return None
        before, shown = dict(work.records), copy.copy(work)
        shown.records = dict(before)

        def done() -> None:
            self.folder, self._stored = place, edits
            for frame, record in shown.records.items():
                if work.records.get(frame) is before[frame]:
                    work.records[frame] = record  # which is on disk now

        return Storing(lambda: save(shown, place), done)

    def replay(self, record: Any, source: str) -> None:
        if self.work is None:
            raise RunError(f"{source} cannot be used: {self.blocked}")
        try:
            if "classes" in record:
                self._set_classes(tuple(LabelClass.stored(*item) for item in record["classes"]))
            else:
                self._restore(tuple(Piece.from_json(item) for item in record["pieces"]))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise RunError(f"{source} does not hold strokes that can be painted again ({what_is_wrong(error)}).") from error

    # Painting

    def ready(self) -> Annotations:
        """The label maps. DegenseError where there is nothing to paint on or with, or another window has it open."""
        work = self._changeable()
        if not work.classes:
            raise DegenseError("There is no class yet: add one, then paint.")
        self.tool.label = min(self.tool.label, len(work.classes) - 1)
        return work

    def _changeable(self) -> Annotations:
        if self.session.store.elsewhere:
            raise DegenseError(self.session.store.problem)
        return self._opened()

    def _opened(self) -> Annotations:
        if self.work is None:
            raise DegenseError(self.blocked or "Open a clip or a run first.")
        return self.work

    def reader(self, frame: int) -> Callable[[], object]:
        """Reads the labels of a frame, in any thread: looking at them waits for no drive then."""
        return self.work.reader(frame) if self.work is not None else lambda: None

    def is_at_hand(self, frame: int) -> bool:
        """Whether looking at the labels of a frame waits for no drive."""
        return self.work is None or self.work.is_at_hand(frame)

    def begin(self, name: str) -> None:
        """Begin a stroke in the frame that is shown. Errors as `ready`."""
        self._stroke = self.ready().stroke(self.session.frame, f"{name} in frame {self.session.frame}")
        self._written = -math.inf  # its first dab is written at once

    def dab(self, region: PixelRegion | None) -> None:
        if self._stroke is not None and region is not None:
            changed = self._stroke.paint(region, self.tool.value, self.tool.inside)
            if changed is not None:
                self.pixels_changed.emit(self._stroke.frame, changed)
                self._unwritten = True
                self.write_stroke()

    def write_stroke(self) -> None:
        """Write an unfinished stroke into the journal, `STROKE_SECONDS` after the last time. Called every second: the hand may rest."""
        now = time.monotonic()
        if self._stroke is None or not self._unwritten or now - self._written < STROKE_SECONDS:
            return
        if (piece := self._stroke.so_far()) is not None:
            self._written, self._unwritten = now, False
            self.changed.emit({"pieces": [piece.to_json()]})

    def end(self) -> None:
        """End the stroke: one step of undo."""
        stroke, self._stroke = self._stroke, None
        if stroke is not None:
            self._record(stroke.finish(), drawn=True)

    def paint(self, name: str, region: PixelRegion | None, value: int | None = None) -> bool:
        """Paint a region in one step, with the tool's value unless one is given; whether that changed anything."""
        frame, tool = self.session.frame, self.tool
        edit = self.ready().paint(frame, f"{name} in frame {frame}", region, tool.value if value is None else value, tool.inside)
        return self._record(edit)

    def labels(self, frame: int) -> np.ndarray:
        """The labels to show of a frame, uint8 [H, W]: with the present stroke, else the proposal or its own."""
        if self._stroke is not None and self._stroke.frame == frame:
            return self._stroke.labels
        return self._opened().shown(frame)

    def labelled_frames(self) -> tuple[int, ...]:
        """Frames with a label map that was made here or came with the clip; none where nothing is open."""
        return annotated(self.work, self.session.clip).frames if self.work is not None else ()

    def snapshot(self) -> MapSet:
        """A copy of the label maps as they are now: painting goes on while they are written. Errors as `ready`."""
        maps = annotated(self.ready(), self.session.clip)
        packed = {frame: pack(maps.read(frame)) for frame in maps.frames}
        return replace(maps, read=lambda frame: unpack(packed[frame], maps.shape))

    # Frames

    def propose(self, proposals: Mapping[int, Proposal], replacing: bool = False) -> None:
        self._record(self.ready().propose(proposals, replacing))

    def accept(self, frames: Sequence[int]) -> None:
        self._record(self.ready().accept(frames))

    def reject(self, frames: Sequence[int]) -> None:
        self._record(self.ready().reject(frames))

    def set_status(self, status: Status) -> None:
        self._record(self.ready().set_status(self.session.frame, status))

    def take(self, classes: Sequence[LabelClass], maps: Mapping[int, np.ndarray], name: str) -> None:
        """Take label maps from elsewhere, of which values index `classes`; classes of the same name are the same."""
        work = self._changeable()
        own, table = merged(work.classes, classes)
        if len(own) > len(work.classes):
            self._edit_classes(f"Classes of {name}", own)
        self._record(work.replace_labels({frame: table[labels] for frame, labels in maps.items()}, name))

    # Classes

    def choose_class(self, index: int) -> None:
        """Paint with another class; an index without a class changes nothing."""
        if self.work is not None and 0 <= index < len(self.work.classes):
            self.tool.choose(label=index)

    def add_class(self, name: str) -> None:
        """Add a class in the next colour, and choose it. DegenseError for a name that is empty or taken."""
        classes = self._changeable().classes
        self._edit_classes(f"Class {name}", (*classes, LabelClass(" ".join(name.split()), default_colour(len(classes)))))
        self.choose_class(len(classes))

    def add_object(self, index: int) -> None:
        """Add another object of a class, such as a second grasper, in the next colour, and choose it."""
        classes = self.ready().classes
        name = classes[index].name
        taken = {kind.number for kind in classes if kind.name.casefold() == name.casefold()}
        added = LabelClass(name, default_colour(len(classes)), next(number for number in count(1) if number not in taken))
        self._edit_classes(f"Another {name}", (*classes, added))
        self.choose_class(len(classes))

    def rename_class(self, index: int, title: str) -> None:
        """Rename a class with all its objects; the number of the object may stand behind the name. Errors as `add_class`."""
        classes = self.ready().classes
        old = classes[index]
        name = " ".join(title.split())
        name = name.removesuffix(f" {old.number}") if old.number > 1 else name
        renamed = (replace(kind, name=name) if kind.name.casefold() == old.name.casefold() else kind for kind in classes)
        self._edit_classes(f"Rename {old.name}", tuple(renamed))

    def recolour_class(self, index: int, colour: tuple[int, int, int]) -> None:
        classes = list(self.ready().classes)
        classes[index] = replace(classes[index], colour=colour)
        self._edit_classes(f"Colour of {classes[index].title}", tuple(classes))

    def _edit_classes(self, title: str, classes: tuple[LabelClass, ...]) -> None:
        check_classes(classes)
        self.session.undo.do(title, self._set_classes, self._opened().classes, classes)

    def _set_classes(self, classes: tuple[LabelClass, ...]) -> None:
        if self.work is not None:
            check_classes(classes)
            self.work.classes = classes
            self._edits += 1
            self.changed.emit({"classes": [[kind.name, kind.colour, kind.number] for kind in classes]})
            self.classes_changed.emit()
            self.pixels_changed.emit(self.session.frame, None)

    # Undo

    def _record(self, edit: LabelEdit | None, drawn: bool = False) -> bool:
        """Make an edit of the label maps a step of undo; whether it changed anything. `drawn`: its pixels are shown already."""
        if edit is not None:
            self.session.undo.record(edit.name, self._restore, edit.before, edit.after, size=edit.size)
            self._announce(edit.after, drawn)
        return edit is not None

    def _restore(self, state: State) -> None:
        if self.work is not None:
            self.work.restore(state)
            self._announce(state)

    def _announce(self, state: State, drawn: bool = False) -> None:
        self._edits += 1
        self.changed.emit({"pieces": [piece.to_json() for piece in state]})
        self.records_changed.emit()
        for frame in () if drawn else [piece.frame for piece in state]:
            self.pixels_changed.emit(frame, None)


def _place(folder: Path, scene: Scene | None) -> Path:
    """Where label maps lie in the folder of a session."""
    return folder / NAME if scene is not None else folder
