"""The paint tool: which it is, its size, the class it paints, and the class that alone may be painted over. No Qt."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, get_args

from degense.app.session.state import Signal
from degense.engine.clip import UNLABELLED
from degense.engine.errors import RunError, what_is_wrong

ToolName = Literal["brush", "eraser", "superpixels", "polygon", "fill", "wand"]
SMALLEST, LARGEST = 0.5, 100.0  # radius of the brush, pixels


class ToolKind(NamedTuple):
    """A tool as menu, panel and keyboard offer it."""

    name: ToolName
    title: str
    key: str
    description: str


TOOLS = (
    ToolKind("brush", "Brush", "B", "Paint the current class"),
    ToolKind("eraser", "Eraser", "E", "Make pixels unlabelled"),
    ToolKind("superpixels", "Superpixels", "S", "Paint whole regions of like colour"),
    ToolKind("polygon", "Polygon", "U", "Click corners; a double click or Enter closes, Backspace takes a corner back, Escape all"),
    ToolKind("fill", "Fill", "G", "Give everything connected under the click the current class"),
    ToolKind("wand", "Wand", "W", "Click the mask of a prompt: its part under the click becomes the current class"),
)


class PaintTool:
    """What the left button does while one annotates."""

    def __init__(self) -> None:
        self.changed: Signal[[]] = Signal()  # name, radius, label or `inside`
        self.active_changed: Signal[[bool]] = Signal()  # (active)
        self._active = False
        self.clear()

    def clear(self) -> None:
        self.name: ToolName = "brush"
        self.radius, self.label = 8.0, 0  # pixels; index of the class that is painted
        self.inside: int | None = None  # the only label that may be painted over; None for any

    @property
    def active(self) -> bool:
        """Whether one is annotating: label maps are shown, and the left button paints."""
        return self._active

    @active.setter
    def active(self, active: bool) -> None:
        if active != self._active:
            self._active = active
            self.active_changed.emit(active)

    @property
    def value(self) -> int:
        """The label that the tool writes."""
        return UNLABELLED if self.name == "eraser" else self.label

    def choose(self, name: ToolName | None = None, radius: float | None = None, label: int | None = None) -> None:
        """Take another tool, radius or class; what is None stays."""
        self.name = name or self.name
        self.radius = self.radius if radius is None else min(LARGEST, max(SMALLEST, radius))
        self.label = self.label if label is None else label
        self.changed.emit()

    def lock(self, inside: int | None) -> None:
        """Paint only over this label (`UNLABELLED`: only over unlabelled pixels); None: over all."""
        self.inside = inside
        self.changed.emit()

    def to_json(self) -> Any:
        return {"tool": self.name, "radius": self.radius, "current": self.label, "inside": self.inside}

    def from_json(self, data: Any, source: str) -> None:
        """The tool that `to_json` wrote. RunError for anything else."""
        try:
            if data["tool"] not in get_args(ToolName):
                raise ValueError(f"{data['tool']!r} is no tool")
            self.name, self.radius = data["tool"], min(LARGEST, max(SMALLEST, float(data["radius"])))
            self.label = max(0, int(data["current"]))
            self.inside = None if data["inside"] is None else int(data["inside"])
        except (KeyError, TypeError, ValueError) as error:
            raise RunError(f"{source} does not hold a paint tool ({what_is_wrong(error)}).") from error
