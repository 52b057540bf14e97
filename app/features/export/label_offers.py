"""What label maps there are to export, and what would be written. No Qt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from degense.app.features.annotate.label_sets import counted
from degense.app.features.anonymise.anonymity import Anonymity
from degense.engine.annotation.formats import LabelFormat, MapSet

#: Names of classes that are listed before the rest is counted.
LISTED = 5


@dataclass(frozen=True)
class LabelOffer:
    """One source of label maps."""

    title: str
    classes: tuple[str, ...]
    frames: tuple[int, ...]  # that have a label map
    maps: Callable[[Anonymity], MapSet]  # a copy as they are now


@dataclass(frozen=True)
class LabelPlan:
    """What is written where; `problem` says why that cannot be done."""

    offer: LabelOffer
    kind: LabelFormat
    frames: tuple[int, ...]  # that are wanted
    out: Path | None

    @property
    def written(self) -> tuple[int, ...]:
        """Frames that are wanted and have a label map."""
        return tuple(sorted(set(self.offer.frames).intersection(self.frames)))

    @property
    def problem(self) -> str:
        if not self.written:
            return "None of these frames is labelled, so there is nothing to export."
        if self.out is None:
            return "Choose where it is written."
        if not self.kind.suffix and (self.out.is_file() or (self.out.is_dir() and any(self.out.iterdir()))):
            return f"{self.out} is not empty; choose another folder."
        if self.kind.suffix and self.out.is_dir():
            return f"{self.out} is a folder; name a file that ends in {self.kind.suffix}."
        return ""

    @property
    def sentence(self) -> str:
        """What will be written, for the user."""
        names = ", ".join(self.offer.classes[:LISTED]) + (f" and {more} more" if (more := len(self.offer.classes) - LISTED) > 0 else "")
        maps = counted(len(self.written), "label map")
        if len(self.written) < len(self.frames):
            maps += f" ({len(self.frames)} frames are chosen, the others have no labels)"
        place = f"the {'file' if self.kind.suffix else 'folder'} {self.out}"
        replaced = ", in place of the file that is there" if self.kind.suffix and self.out is not None and self.out.is_file() else ""
        return f"Writes {maps} of {counted(len(self.offer.classes), 'class', 'classes')} ({names}) into {place}{replaced}."
