"""A clip: frames, cameras, depth and labels of a surgical video, whatever layout it came from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from degense.engine.camera import Camera

UNLABELLED = 255


@dataclass(frozen=True)
class Truth:
    """Ground truth of a synthetic clip (`gt.npz`)."""

    #: float32 [T, H, W, 3]; offset of the material point seen in a pixel from its place at frame 0; scene units, camera frame; NaN where no
    #: tissue is seen.
    displacement: np.ndarray
    #: bool [T, H, W]; pixels whose tissue has changed its appearance in place: charred tissue, which is static, or bled tissue, which moves
    #: as it would without the blood. Any motion shown there beyond `displacement` is spurious.
    cautery: np.ndarray
    #: float32 [K, T, 3]; where points of tissue are in each frame; scene units, world axes; NaN where that is not known.
    tracks: np.ndarray | None = None
    visible: np.ndarray | None = None  # bool [K, T]; whether each of them is seen in each frame


def held_out(count: int) -> list[int]:
    """The frames of a clip of `count` frames that are never trained on: see `Clip.test_frames`."""
    return list(range(1, count, 8)) if count > 2 else []


@dataclass
class Clip(ABC):
    """Frames, cameras, validity, depth and labels of one video. Pixels are read when asked for and stay uint8.

    Poses "given": `cameras` are known. Else they are static until `find_cameras` has estimated them from the frames; with "auto" the frames
    also decide whether the camera moves. `provenance` says in words for the user where each thing comes from: keys `frames`, `poses`,
    `focal`, `masks`, `depth`, `labels`, and `strokes` where there are any.
    """

    name: str
    path: Path  # the folder or file it was opened from
    cameras: list[Camera]  # one a frame (the same object while the camera is static), in the clip's own unit
    classes: tuple[str, ...] = ()  # names of the label values 0, 1, …; empty when nothing beside the clip names any
    provenance: dict[str, str] = field(default_factory=dict)
    unit: str = "scene units"  # name of the clip's length: "mm" where depth is metric
    fps: float = 25.0  # frames of the clip a second of the recording: its rate, 25 where it does not say, over the stride
    options: dict[str, Any] = field(default_factory=dict)  # what the reader was told beyond its defaults; a run keeps it to open it again
    poses: Literal["given", "auto", "estimate"] = "given"

    def __len__(self) -> int:
        return len(self.cameras)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels, the same for every frame."""
        return self.cameras[0].width, self.cameras[0].height

    def time(self, index: float) -> float:
        """Time of a frame (fractions lie between frames), mapped to [-1, 1]; 0 for a clip of one frame."""
        return 2.0 * index / (len(self) - 1) - 1.0 if len(self) > 1 else 0.0

    @property
    def test_frames(self) -> list[int]:
        """Held-out frames, (i − 1) % 8 == 0; never trained on. A clip too short to hold any out has none."""
        return held_out(len(self))

    @property
    def train_frames(self) -> list[int]:
        held_out = set(self.test_frames)
        return [i for i in range(len(self)) if i not in held_out]

    @property
    def labelled_frames(self) -> list[int]:
        """Frames that have a label map, ascending."""
        return []

    @abstractmethod
    def frame(self, index: int) -> np.ndarray:
        """RGB, uint8 [H, W, 3]."""

    @abstractmethod
    def valid(self, index: int) -> np.ndarray:
        """Pixels to reconstruct and to score, bool [H, W]: inside the field of view and not excluded by a tool mask."""

    @abstractmethod
    def depth(self, index: int) -> np.ndarray:
        """Camera depth z, float32 [H, W], clip units, 0 where unknown. `provenance["depth"]` says whether it was measured or is a prior."""

    @property
    @abstractmethod
    def depth_measured(self) -> bool:
        """True when depth comes from files and may be supervised; False for a prior that only initialises."""

    def labels(self, index: int) -> np.ndarray | None:
        """Label map, uint8 [H, W], values index `classes`, `UNLABELLED` where unlabelled; None when the frame has none."""
        return None

    @property
    def stroked_frames(self) -> list[int]:
        """Frames on which somebody scribbled classes, ascending."""
        return []

    def strokes(self, index: int) -> np.ndarray | None:
        """Scribbles: a label map, uint8 [H, W], that is `UNLABELLED` nearly everywhere; None when the frame has none."""
        return None

    def truth(self) -> Truth | None:
        """Ground truth when the clip brings it."""
        return None
