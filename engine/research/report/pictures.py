"""Pictures of a report: a recorded frame, its true labels, and what a method makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.colour_maps import mask_overlay
from degense.engine.layers.layer import MASK_COLOURS
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet

SHOWN = 3  # frames
WIDEST = 420  # pixels


@dataclass(frozen=True)
class ReportPicture:
    """One picture of one frame.

    Attributes
    ----------
    frame : int
    caption : str
        Whose it is: "recorded", "truth" or the name of a method.
    image : uint8 [H, W, 3]
        RGB, at most `WIDEST` wide.
    """

    frame: int
    caption: str
    image: np.ndarray


def shown_frames(mask_frames: Sequence[int]) -> list[int]:
    """The frames that a report shows: the first, one in the middle and the last of those that masks are scored on."""
    chosen = np.unique(np.linspace(0, len(mask_frames) - 1, min(SHOWN, len(mask_frames))).round().astype(int))
    return [mask_frames[i] for i in chosen]


def pictures_of(scene: Scene, clip: Clip, mask_frames: Sequence[int], decoder: str, caption: str) -> list[ReportPicture]:
    """What a scene makes of the shown frames: its label map by a decoder, over its own picture."""
    prompts = PromptSet(tuple(clip.classes), decoder=decoder)
    return [
        ReportPicture(frame, caption, painted(scene.render_rgb(frame), decode_frame(scene, prompts, frame).labels))
        for frame in shown_frames(mask_frames)
    ]


def truths_of(clip: Clip, mask_frames: Sequence[int]) -> list[ReportPicture]:
    """The shown frames as recorded, and with their true labels."""
    found = []
    for frame in shown_frames(mask_frames):
        recorded, labels = clip.frame(frame), clip.labels(frame)
        assert labels is not None
        found += [ReportPicture(frame, "recorded", small(recorded)), ReportPicture(frame, "truth", painted(recorded, labels))]
    return found


def painted(rgb: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """A label map, uint8 [H, W], in the colours of `class_colour` over a picture, uint8 [H, W, 3]; small."""
    masks = [(labels == value, class_colour(int(value))) for value in np.unique(labels) if value != UNLABELLED]
    if not masks:
        return small(rgb)
    over = mask_overlay(masks, fill=0.55)
    alpha = over[..., 3:].astype(np.float32) / 255
    return small((rgb * (1 - alpha) + over[..., :3] * alpha + 0.5).astype(np.uint8))


def class_colour(index: int) -> tuple[int, int, int]:
    """The colour of a class; further classes take the same colours, darker each round."""
    red, green, blue = (int(c * 0.6 ** (index // len(MASK_COLOURS))) for c in MASK_COLOURS[index % len(MASK_COLOURS)])
    return red, green, blue


def small(image: np.ndarray) -> np.ndarray:
    """At most `WIDEST` wide."""
    height, width = image.shape[:2]
    if width <= WIDEST:
        return image
    return cv2.resize(image, (WIDEST, max(1, round(height * WIDEST / width))), interpolation=cv2.INTER_AREA)
