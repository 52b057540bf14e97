"""Label classes, and edits of label maps as states to go back to: the changed box before and after, compressed."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from degense.engine.clip import UNLABELLED
from degense.engine.colour_maps import CLASS_COLOURS
from degense.engine.errors import DegenseError

Colour = tuple[int, int, int]
LONGEST_NAME = 200


@dataclass(frozen=True)
class LabelClass:
    """What a value of a label map means; its index in the list of classes is the value.

    Two graspers are two values of one class: their names are the same, their numbers are 1 and 2.
    """

    name: str
    colour: Colour
    number: int = 1  # which object of its class

    @classmethod
    def stored(cls, name: Any, colour: Any, number: Any = 1) -> LabelClass:
        """As annotations and journals hold it; earlier versions wrote no number. Parts of a colour are brought into 0 to 255.

        TypeError or ValueError for what is no class.
        """
        red, green, blue = (min(255, max(0, int(part))) for part in colour)
        return cls(str(name), (red, green, blue), int(number))

    @property
    def title(self) -> str:
        """What the user reads: the name, with the number of a second or further object."""
        return self.name if self.number == 1 else f"{self.name} {self.number}"


def default_colour(index: int) -> Colour:
    """Colours that colour-blind readers tell apart; they repeat after the last."""
    return CLASS_COLOURS[index % len(CLASS_COLOURS)]


def named_classes(names: Iterable[str]) -> tuple[LabelClass, ...]:
    """Classes in the default colours."""
    return tuple(LabelClass(name, default_colour(index)) for index, name in enumerate(names))


def check_classes(classes: Sequence[LabelClass]) -> None:
    """DegenseError when there are too many classes, or a name is empty, too long or twice there."""
    if len(classes) > UNLABELLED:
        raise DegenseError(f"There are {len(classes)} classes, but a label map holds at most {UNLABELLED}.")
    titles = [kind.title.casefold() for kind in classes]
    for kind, title in zip(classes, titles, strict=True):
        if not kind.name.strip() or len(kind.name) > LONGEST_NAME or not kind.name.isprintable():
            raise DegenseError(f"A class needs a name of 1 to {LONGEST_NAME} letters.")
        if not 1 <= kind.number <= UNLABELLED:
            raise DegenseError(f"The number of an object is 1 to {UNLABELLED}, not {kind.number}.")
        if titles.count(title) > 1:
            raise DegenseError(f"There is a class “{kind.title}” already.")


def merged(own: Sequence[LabelClass], others: Sequence[LabelClass]) -> tuple[tuple[LabelClass, ...], np.ndarray]:
    """All classes, `own` first; and what each value of the others' label maps is among them, uint8 [256].

    Classes of the same title, whatever its case, are the same. DegenseError when there are more than a label map holds.
    """
    classes = list(own)
    index = {kind.title.casefold(): number for number, kind in enumerate(classes)}
    table = np.full(256, UNLABELLED, np.uint8)
    for value, kind in enumerate(others):
        if kind.title.casefold() not in index:
            index[kind.title.casefold()] = len(classes)
            classes.append(kind)
            check_classes(classes)
        table[value] = index[kind.title.casefold()]
    return tuple(classes), table


#: Confidence below which a proposal is listed for review.
DOUBTFUL = 0.75


def pack(labels: np.ndarray) -> bytes:
    """uint8 [H, W], compressed; regions of one value cost next to nothing."""
    return zlib.compress(np.ascontiguousarray(labels, np.uint8).tobytes(), 1)


def unpack(packed: bytes, shape: tuple[int, int]) -> np.ndarray:
    """What `pack` was given, uint8 [H, W], writable. ValueError when the bytes are not a map of this shape; never more is allocated."""
    height, width = shape
    decompressor = zlib.decompressobj()
    try:
        data = decompressor.decompress(packed, height * width + 1)
    except zlib.error as error:
        raise ValueError(f"not a packed label map ({error})") from error
    if len(data) != height * width:
        raise ValueError(f"a packed label map of {len(data)} bytes or more, but {width} × {height} pixels were expected")
    return np.frombuffer(bytearray(data), np.uint8).reshape(height, width)


@dataclass(frozen=True)
class Proposal:
    """A label map propagated from other frames, (height, width) = `shape`.

    `confidence`, in [0, 1], is the expected intersection over union, averaged over the classes in the map; `unknown` the share of pixels
    without a label because they show what no corrected frame shows.
    """

    packed: bytes
    shape: tuple[int, int]
    confidence: float
    unknown: float = 0.0

    @property
    def labels(self) -> np.ndarray:
        """uint8 [H, W]."""
        return unpack(self.packed, self.shape)

    @property
    def doubtful(self) -> bool:
        return self.confidence < DOUBTFUL or self.unknown > 0

    @property
    def doubt(self) -> float:
        """The expected error, in [0, 1]; what is unknown counts as wrong."""
        return max(1 - self.confidence, self.unknown)

    def numbers(self) -> dict[str, float]:
        """What is written of it beside its labels."""
        return {"confidence": self.confidence, "unknown": self.unknown}

    @classmethod
    def of(cls, packed: bytes, shape: tuple[int, int], numbers: Mapping[str, Any]) -> Proposal:
        """What `numbers` described; earlier versions knew of nothing unknown."""
        return cls(packed, shape, *(min(1.0, max(0.0, float(number))) for number in (numbers["confidence"], numbers.get("unknown", 0.0))))


Status = Literal["open", "in progress", "done", "flagged"]
STATUSES: tuple[Status, ...] = get_args(Status)


@dataclass(frozen=True)
class Piece:
    """The state of one frame, as far as an edit touches it."""

    frame: int
    top: int  # of the box; an empty one (height 0) where the edit does not touch pixels
    left: int
    height: int
    width: int
    packed: bytes  # the labels in the box
    labelled: bool  # whether the frame has a label map of its own
    by_hand: bool  # whether it was edited by hand: such frames are propagated to the others
    status: Status
    proposal: Proposal | None  # the proposal from other frames that waits for an answer

    @property
    def size(self) -> int:
        """Bytes that it holds."""
        return 200 + len(self.packed) + (len(self.proposal.packed) if self.proposal else 0)

    def to_json(self) -> dict[str, Any]:
        proposal = None
        if self.proposal is not None:
            proposal = {"labels": _text(self.proposal.packed), "shape": self.proposal.shape, **self.proposal.numbers()}
        return {
            "frame": self.frame,
            "box": [self.top, self.left, self.height, self.width],
            "labels": _text(self.packed),
            "labelled": self.labelled,
            "by_hand": self.by_hand,
            "status": self.status,
            "carried": proposal,
        }

    @classmethod
    def from_json(cls, data: Any) -> Piece:
        """What `to_json` wrote; ValueError, TypeError or KeyError otherwise."""
        top, left, height, width = (int(number) for number in data["box"])
        proposal = data["carried"]
        if proposal is not None:
            rows, columns = (int(number) for number in proposal["shape"])
            proposal = Proposal.of(base64.b85decode(proposal["labels"]), (rows, columns), proposal)
        if data["status"] not in STATUSES:
            raise ValueError(f"{data['status']!r} is no status")
        packed = base64.b85decode(data["labels"])
        flags = bool(data["labelled"]), bool(data["by_hand"])
        return cls(int(data["frame"]), top, left, height, width, packed, *flags, data["status"], proposal)


#: All frames that one edit touches.
State = tuple[Piece, ...]


@dataclass(frozen=True)
class LabelEdit:
    """One step: what to call it, and the states before and after."""

    name: str
    before: State
    after: State

    @property
    def size(self) -> int:
        return sum(piece.size for piece in (*self.before, *self.after))


def _text(data: bytes) -> str:
    return base64.b85encode(data).decode("ascii")
