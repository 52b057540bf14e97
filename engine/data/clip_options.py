"""What a user may say about a clip that its files do not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from degense.engine.errors import ClipError

MaskMeans = Literal["tool", "keep"]
PoseAxes = Literal["llff", "opencv"]
Poses = Literal["auto", "still", "estimate"]

LAYOUTS = ("endonerf", "cholecseg8k", "endovis18", "stir", "surgt", "servct", "c3vd", "nerfstudio", "colmap", "frames", "video")


@dataclass(frozen=True)
class ClipOptions:
    """Answers that overrule what the reader would decide by itself. What was decided stands in `Clip.provenance`.

    ClipError when a value is not allowed.
    """

    layout: str | None = None  # one of `LAYOUTS`; None: `detect` chooses
    #: What the high value of a mask marks: pixels to leave out, or pixels to reconstruct. None: decided by
    #: evidence.
    mask_means: MaskMeans | None = None
    focal: float | None = None  # focal length in pixels; None: from the clip's cameras, else 70° across the field of view
    #: What the three rotation columns of a moving camera's `poses_bounds.npy` are: (down, right, back), as the format
    #: defines them, or (right, down, forward), as some converters write them. The numbers alone cannot tell.
    pose_axes: PoseAxes = "llff"
    #: Whether the camera moves. "auto": as the clip says, else training finds out; "still": it does not;
    #: "estimate": it does, and its poses are estimated from the frames even where the clip brings some.
    poses: Poses = "auto"
    labels: str | None = None  # a folder with `labels/` and `classes.json` that is read instead of the clip's own label maps
    start: int = 0  # of a video file, frames are used from `start` on, each `stride`-th one, at most `max_frames`
    stride: int = 1
    max_frames: int = 2000

    def __post_init__(self) -> None:
        if self.layout is not None and self.layout not in LAYOUTS:
            raise ClipError(f"There is no clip layout {self.layout!r}; it is one of {', '.join(LAYOUTS)}.")
        for name, choices in (("mask_means", (None, *get_args(MaskMeans))), ("pose_axes", get_args(PoseAxes)), ("poses", get_args(Poses))):
            if (value := getattr(self, name)) not in choices:
                raise ClipError(f"{name} is {value!r}, but must be one of {', '.join(repr(choice) for choice in choices if choice)}.")
        if self.focal is not None and not (math.isfinite(self.focal) and self.focal > 0):
            raise ClipError(f"The focal length is {self.focal}, but must be a positive number of pixels.")
        if self.start < 0 or self.stride < 1 or self.max_frames < 1:
            raise ClipError("start must be 0 or more, stride and max_frames 1 or more.")
