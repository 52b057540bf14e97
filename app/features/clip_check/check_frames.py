"""What was found in a clip, on its frames: for the user to check before anything is made of it. No Qt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from degense.app.features.clip_check.camera_plan import angle_plan, field_of_view, path_plan
from degense.app.session.view_state import PROMPT_COLOURS, Colour
from degense.engine.colour_maps import UNKNOWN, colourise, mask_overlay

if TYPE_CHECKING:
    from degense.engine.clip import Clip

#: What can be checked, and on which view.
ASPECTS = {
    "frames": "Recorded frame",
    "masks": "What is left out",
    "focal": "Angle of view, from above",
    "poses": "Camera path, from above",
    "depth": "Depth",
    "labels": "Annotations",
}
TOOL: Colour = PROMPT_COLOURS[5]
OUTSIDE: Colour = PROMPT_COLOURS[1]
#: Frames that are used to tell the border of the frame, which never changes, from instruments.
BORDER_FRAMES = 5
DEPTH_MAP = "cividis"


@dataclass(frozen=True)
class CheckFrame:
    """A frame of a clip seen under one aspect."""

    rgb: np.ndarray  # uint8 [H, W, 3]
    overlay: np.ndarray | None  # uint8 [H, W, 4]
    legend: tuple[tuple[str, Colour], ...]  # what the colours mean


def draw_check_frame(clip: Clip, frame: int, aspect: str) -> CheckFrame:
    rgb = clip.frame(frame)
    match aspect:
        case "focal" | "poses":
            plan, legend = angle_plan(clip, frame) if aspect == "focal" else path_plan(clip, frame)
            return CheckFrame(plan, None, legend)
        case "masks":
            return _masks(clip, frame, rgb)
        case "depth":
            return _depth(clip, frame)
        case "labels":
            return _labels(clip, frame, rgb)
    return CheckFrame(rgb, None, ())


def field_of_view_words(clip: Clip) -> str:
    """The angle of view that the focal length amounts to."""
    across, down = field_of_view(clip.cameras[0])
    return f"{clip.cameras[0].fx:.0f} px shows {across:.0f}° across and {down:.0f}° down"


def _masks(clip: Clip, frame: int, rgb: np.ndarray) -> CheckFrame:
    watched = np.unique(np.linspace(0, len(clip) - 1, min(len(clip), BORDER_FRAMES)).round().astype(int))
    border = ~np.logical_or.reduce([clip.valid(int(index)) for index in (*watched, frame)])
    tool = ~clip.valid(frame) & ~border
    areas = [(f"{words}: {area.mean():.0%}", area, colour) for words, area, colour in (
        ("left out in this frame, instrument", tool, TOOL),
        ("left out in every frame, border", border, OUTSIDE),
    ) if area.any()]  # fmt: skip
    kept = 1 - float((tool | border).mean())
    overlay = mask_overlay([(area, colour) for _, area, colour in areas], 0.45) if areas else None
    legend = tuple((words, colour) for words, _, colour in areas)
    return CheckFrame(rgb, overlay, (*legend, (f"reconstructed: {kept:.0%}", (235, 235, 235))))


def _depth(clip: Clip, frame: int) -> CheckFrame:
    depth = clip.depth(frame).astype(np.float64)
    known = depth > 0
    if not known.any():
        return CheckFrame(np.full((*depth.shape, 3), UNKNOWN, np.uint8), None, (("depth is not known here", UNKNOWN),))
    low, high = (float(value) for value in np.percentile(depth[known], (2, 98)))
    colours = colourise(np.where(known, depth, np.nan), DEPTH_MAP, low, max(high, low + 1e-6))
    ends = colourise(np.array([low, high]), DEPTH_MAP, low, max(high, low + 1e-6)).astype(int)
    legend = [
        (f"{words} {value:.3g} {clip.unit}", (int(c[0]), int(c[1]), int(c[2])))
        for words, value, c in (("near", low, ends[0]), ("far", high, ends[1]))
    ]
    unknown = [(f"unknown: {1 - known.mean():.0%}", UNKNOWN)] if not known.all() else []
    return CheckFrame(colours, None, (*legend, *unknown))


def _labels(clip: Clip, frame: int, rgb: np.ndarray) -> CheckFrame:
    labels = clip.labels(frame)
    if labels is None:
        labels = clip.strokes(frame)
    if labels is None:
        return CheckFrame(rgb, None, (("this frame is not annotated", UNKNOWN),))
    shown = [
        (name, labels == index, PROMPT_COLOURS[index % len(PROMPT_COLOURS)])
        for index, name in enumerate(clip.classes)
        if (labels == index).any()
    ]
    overlay = mask_overlay([(area, colour) for _, area, colour in shown], 0.45) if shown else None
    return CheckFrame(rgb, overlay, tuple((f"{name}: {area.mean():.0%}", colour) for name, area, colour in shown))
