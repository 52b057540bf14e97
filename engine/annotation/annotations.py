"""The label maps of a clip while they are being made: edited, undone, propagated to other frames, accepted or rejected, reviewed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from degense.engine.annotation.edits import LabelClass, LabelEdit, Piece, Proposal, State, Status, check_classes, pack, unpack
from degense.engine.annotation.painting import PixelRegion, region_of
from degense.engine.clip import UNLABELLED
from degense.engine.latest import Latest

#: Maps that stay decoded.
KEPT = 8


class LabelsOnDisk(Protocol):
    """Reads a label map."""

    at_hand: bool  # whether that waits for no disk

    def __call__(self) -> np.ndarray: ...


#: A label map of its own: compressed, or what reads it.
Labels = bytes | LabelsOnDisk


@dataclass(frozen=True)
class Record:
    """What is known of one frame."""

    labels: Labels | None = None
    by_hand: bool = False
    status: Status = "open"
    proposal: Proposal | None = None


EMPTY = Record()


class Annotations:
    """Label maps, uint8 [H, W] with values that index `classes` and `UNLABELLED` (255), of which only a few are decoded at a time.

    `shape` is (height, width), `count` the number of frames. `original` gives the label map that a frame came with, or None; it is never
    changed.
    """

    def __init__(
        self,
        classes: Sequence[LabelClass],
        shape: tuple[int, int],
        count: int,
        original: Callable[[int], np.ndarray | None] = lambda frame: None,
    ):
        check_classes(classes)
        self.classes, self.shape, self.count = tuple(classes), shape, count
        self.original = original
        self.records: dict[int, Record] = {}
        self._decoded = Latest(KEPT)

    # -- looking ---------------------------------------------------------------------------------------------------------------------------
    def record(self, frame: int) -> Record:
        return self.records.get(frame, EMPTY)

    def labels(self, frame: int) -> np.ndarray:
        """The frame's own map, else the one it came with, else nothing labelled; read-only."""
        return self._decoded.get(frame, lambda: self._read(frame))

    def shown(self, frame: int) -> np.ndarray:
        """The proposal that waits for an answer, else `labels`; read-only."""
        proposal = self.record(frame).proposal
        return self.labels(frame) if proposal is None else proposal.labels

    def reader(self, frame: int) -> Callable[[], np.ndarray]:
        """Reads the frame's map as it is now, uint8 [H, W], also in another thread while the frame is changed."""
        labels, original, shape = self.record(frame).labels, self.original, self.shape
        if isinstance(labels, bytes):
            return lambda: unpack(labels, shape)
        return labels or (lambda: _or_nothing(original(frame), shape))

    def is_at_hand(self, frame: int) -> bool:
        """Whether looking at the frame's own map waits for no disk; True where it has none."""
        labels = self.record(frame).labels
        return labels is None or isinstance(labels, bytes) or labels.at_hand

    def is_labelled(self, frame: int) -> bool:
        """Whether the frame has a map, its own or one that it came with."""
        return self.record(frame).labels is not None or self.original(frame) is not None

    def sources(self, frame: int | None = None) -> list[int]:
        """Frames to propagate to the others: those edited by hand, and `frame` if it has a map."""
        found = {index for index, record in self.records.items() if record.by_hand}
        if frame is not None and self.is_labelled(frame):
            found.add(frame)
        return sorted(found)

    def waiting(self) -> list[int]:
        """Frames with a proposal that is neither accepted nor rejected."""
        return sorted(index for index, record in self.records.items() if record.proposal is not None)

    def kinds(self, came: Iterable[int] = ()) -> dict[str, list[int]]:
        """Frames by what their labels are: `doubtful` (a doubtful proposal, or flagged), `proposed`, `painted`, `accepted`.

        `came` are the frames that came with a map; those of which nothing else is known are `labels of the clip`.
        """
        found: dict[str, list[int]] = {}
        for frame in sorted({*came, *self.records}):
            record = self.record(frame)
            if record.status == "flagged" or (record.proposal is not None and record.proposal.doubtful):
                kind = "doubtful"
            elif record.proposal is not None:
                kind = "proposed"
            elif record.labels is not None:
                kind = "painted" if record.by_hand else "accepted"
            elif frame in came:
                kind = "labels of the clip"
            else:
                continue
            found.setdefault(kind, []).append(frame)
        return found

    def doubt(self, frame: int) -> float:
        """How much a frame asks to be looked at, in [0, 1]: 1 where it is flagged, else by its proposal's confidence; 0 without one."""
        record = self.record(frame)
        if record.status == "flagged":
            return 1.0
        return 0.0 if record.proposal is None else record.proposal.doubt

    def review_queue(self) -> list[int]:
        """Frames to look at, the most doubtful first: flagged, or with a doubtful proposal."""
        return sorted(self.kinds().get("doubtful", []), key=lambda frame: (-self.doubt(frame), frame))

    def next_in_queue(self, frame: int, step: int = 1) -> int | None:
        """The frame of the review queue `step` after this one, round and round; the first or last from elsewhere. None when it is empty."""
        queue = self.review_queue()
        if not queue:
            return None
        return queue[(queue.index(frame) + step) % len(queue)] if frame in queue else queue[0 if step > 0 else -1]

    def _read(self, frame: int) -> np.ndarray:
        found = self.reader(frame)()
        found.flags.writeable = False
        return found

    def _keep(self, frame: int, labels: np.ndarray) -> None:
        labels.flags.writeable = False
        self._decoded.keep(frame, labels)

    # -- editing ---------------------------------------------------------------------------------------------------------------------------
    def stroke(self, frame: int, name: str) -> Stroke:
        """Begin to paint. Nothing else may change the frame until the stroke is finished."""
        return Stroke(self, frame, name)

    def paint(self, frame: int, name: str, region: PixelRegion | None, value: int, inside: int | None = None) -> LabelEdit | None:
        """Give the pixels of a region a label; with `inside` only those that have that label now. None when nothing changes."""
        stroke = self.stroke(frame, name)
        if region is not None:
            stroke.paint(region, value, inside)
        return stroke.finish()

    def replace_labels(self, maps: Mapping[int, np.ndarray], name: str) -> LabelEdit | None:
        """Give frames other label maps, uint8 [H, W], as if by hand."""
        return self._edit(name, {frame: Record(pack(labels), True, "done", None) for frame, labels in maps.items()}, pixels=True)

    def set_status(self, frame: int, status: Status) -> LabelEdit | None:
        return self._edit(f"Frame {frame}: {status}", {frame: replace(self.record(frame), status=status)})

    def propose(self, proposals: Mapping[int, Proposal], replacing: bool = False) -> LabelEdit | None:
        """Add proposals, except for frames edited by hand, and but for `replacing` for those that have a map."""
        free = [frame for frame in proposals if not (self.record(frame).by_hand if replacing else self.is_labelled(frame))]
        news = {frame: replace(self.record(frame), proposal=proposals[frame]) for frame in free}
        return self._edit(f"Propagate labels to {len(news)} frames", news)

    def accept(self, frames: Iterable[int]) -> LabelEdit | None:
        """Make proposals the maps of their frames."""
        waiting = {frame: proposal for frame in frames if (proposal := self.record(frame).proposal) is not None}
        news = {frame: Record(proposal.packed, False, "done", None) for frame, proposal in waiting.items()}
        return self._edit(f"Accept frame {next(iter(news))}" if len(news) == 1 else f"Accept {len(news)} frames", news, pixels=True)

    def reject(self, frames: Iterable[int]) -> LabelEdit | None:
        """Throw proposals away: the frames show what they had before."""
        news = {frame: replace(self.record(frame), proposal=None) for frame in frames if self.record(frame).proposal is not None}
        return self._edit(f"Reject frame {next(iter(news))}" if len(news) == 1 else f"Reject {len(news)} frames", news)

    def restore(self, state: State) -> None:
        """Put frames back into a state of an `LabelEdit`. ValueError when it does not fit (a damaged journal)."""
        for piece in state:
            self._restore(piece)

    def _restore(self, piece: Piece) -> None:
        height, width = self.shape
        fits = 0 <= piece.top <= piece.top + piece.height <= height and 0 <= piece.left <= piece.left + piece.width <= width
        if not fits or not 0 <= piece.frame < self.count or (piece.proposal is not None and piece.proposal.shape != self.shape):
            raise ValueError(f"an edit of frame {piece.frame} does not fit a clip of {self.count} frames of {width} × {height}")
        labels = self.record(piece.frame).labels
        if not piece.labelled:
            labels = None
            self._decoded.forget(piece.frame)
        elif piece.height:
            whole = self.labels(piece.frame).copy()
            box = slice(piece.top, piece.top + piece.height), slice(piece.left, piece.left + piece.width)
            whole[box] = unpack(piece.packed, (piece.height, piece.width))
            labels = pack(whole)
            self._keep(piece.frame, whole)
        record = Record(labels, piece.by_hand, piece.status, piece.proposal)
        if record == EMPTY:
            self.records.pop(piece.frame, None)
        else:
            self.records[piece.frame] = record

    def piece(self, frame: int, region: PixelRegion | None = None) -> Piece:
        """The frame's present state, with the pixels of the region's box."""
        record = self.record(frame)
        top, left, height, width, packed = 0, 0, 0, 0, b""
        if region is not None:
            (top, left), (height, width) = (region.top, region.left), region.mask.shape
            packed = pack(self.labels(frame)[region.box])
        return Piece(frame, top, left, height, width, packed, record.labels is not None, record.by_hand, record.status, record.proposal)

    def _edit(self, name: str, news: Mapping[int, Record], *, pixels: bool = False) -> LabelEdit | None:
        """Set records; `pixels`: their maps differ too."""
        whole = PixelRegion(0, 0, np.ones(self.shape, bool)) if pixels else None
        news = {frame: record for frame, record in news.items() if record != self.record(frame)}
        if not news:
            return None
        before = tuple(self.piece(frame, whole) for frame in news)
        for frame, record in news.items():
            self.records[frame] = record
            if pixels:
                self._decoded.forget(frame)
        return LabelEdit(name, before, tuple(self.piece(frame, whole) for frame in news))


def _or_nothing(labels: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
    return np.full(shape, UNLABELLED, np.uint8) if labels is None else labels


class Stroke:
    """Painting that is one step of undo; `labels`, uint8 [H, W], are as painted so far.

    A frame that shows a proposal is painted on the proposal, which thereby is accepted.
    """

    def __init__(self, annotations: Annotations, frame: int, name: str):
        self.annotations, self.frame, self.name = annotations, frame, name
        self.labels = annotations.shown(frame).copy()
        self._start = annotations.labels(frame)
        self._changed = False

    def paint(self, region: PixelRegion, value: int, inside: int | None = None) -> PixelRegion | None:
        """Paint a region; returns what changed, None when nothing did."""
        part = self.labels[region.box]
        mask = region.mask & (part != value)
        if inside is not None:
            mask &= part == inside
        if not mask.any():
            return None
        part[mask] = value
        self._changed = True
        return PixelRegion(region.top, region.left, mask)

    def so_far(self) -> Piece | None:
        """What would be the frame's state if the stroke ended now, for a journal; None when it has changed nothing."""
        region = region_of(self._start != self.labels) if self._changed else None
        if region is None:
            return None
        height, width = region.mask.shape
        packed = pack(self.labels[region.box])
        return Piece(self.frame, region.top, region.left, height, width, packed, True, True, self._status, None)

    @property
    def _status(self) -> Status:
        return "flagged" if self.annotations.record(self.frame).status == "flagged" else "in progress"

    def finish(self) -> LabelEdit | None:
        """End the stroke; None when it changed nothing."""
        if not self._changed:
            return None
        annotations, frame = self.annotations, self.frame
        region = region_of(self._start != self.labels)
        before = annotations.piece(frame, region)
        annotations.records[frame] = Record(pack(self.labels), True, self._status, None)
        annotations._keep(frame, self.labels)
        return LabelEdit(self.name, (before,), (annotations.piece(frame, region),))
