"""Label maps of further frames of a clip, drawn for scoring alone: IoU of each class in each of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.engine.annotation.formats import LABEL_FORMATS
from degense.engine.clip import UNLABELLED, Clip
from degense.engine.data.files.stored import frame_names
from degense.engine.errors import DegenseError
from degense.engine.metrics.masks import MaskScores
from degense.engine.metrics.semantics import NOT_SCORED
from degense.engine.research.baselines.clip_flow import ClipFlow
from degense.engine.research.baselines.masks import propagated
from degense.engine.research.bench.table import Cell, Column

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: IoU by class name; by frame, as JSON has it.
FrameScores = dict[str, dict[str, float | None]]


def read_held_out_maps(path: Path, clip: Clip) -> dict[int, np.ndarray]:
    """Label maps uint8 [H, W] by frame, of a COCO file; what it calls otherwise than the clip's classes is `UNLABELLED`.

    ClipError when it does not fit the clip, DegenseError when the clip has a label map of one of the frames: that is trained on.
    """
    found = LABEL_FORMATS["coco"].read(path, clip.size[::-1], frame_names(clip)).by_class()
    if known := set(found.frames) & set(clip.labelled_frames):
        raise DegenseError(f"{path.name} has a map of frame {min(known)}, which {clip.name} is trained with; leave it out.")
    table = np.full(256, UNLABELLED, np.uint8)
    for value, kind in enumerate(found.classes):
        if kind.name in clip.classes:
            table[value] = clip.classes.index(kind.name)
    return {frame: table[found.read(frame)] for frame in found.frames}


def score_maps(clip: Clip, maps: Mapping[int, np.ndarray], masks: Callable[[int], np.ndarray]) -> FrameScores:
    """IoU by frame and class, as in `MaskScores`, of masks bool [classes, H, W] of each frame."""
    scores = MaskScores(clip.classes, NOT_SCORED)
    for frame, truth in maps.items():
        scores.add_masks(masks(frame), truth, clip.valid(frame))
    by_class = scores.result()["iou_frames"]
    return {str(frame): {name: values[k] for name, values in by_class.items()} for k, frame in enumerate(maps)}


def score_scene_maps(scene: Scene, clip: Clip, maps: Mapping[int, np.ndarray]) -> FrameScores:
    """Of the masks that the window shows when all classes are prompts."""
    from degense.engine.scene.clip_query import decode_frame
    from degense.engine.semantics.prompts import PromptSet

    return score_maps(clip, maps, lambda frame: decode_frame(scene, PromptSet(clip.classes), frame).masks)


def score_first_map(clip: Clip, maps: Mapping[int, np.ndarray]) -> dict[str, dict[str, Any]]:
    """Of the clip's first label map: as it is, and as chained optical flow carries it."""
    first, flow, values = clip.labelled_frames[0], ClipFlow(clip), np.arange(len(clip.classes))[:, None, None]
    drawn = clip.labels(first)
    assert drawn is not None
    labels: np.ndarray = drawn
    answers: dict[str, Callable[[int], np.ndarray]] = {
        "first label map, copied": lambda frame: labels == values,
        "first label map along chained flow": lambda frame: propagated(flow, frame, first, labels) == values,
    }
    return {name: {"held_out_maps": score_maps(clip, maps, answer)} for name, answer in answers.items()}


def columns_of(several: Sequence[Mapping[str, Any]]) -> list[Column]:
    """Frame, and each class that any answer of any frame has an IoU of."""
    names = dict.fromkeys(
        name for scores in several for by_class in scores["held_out_maps"].values() for name, value in by_class.items() if value is not None
    )
    return [Column("method", "method"), Column("frame", "frame", 0), *(Column(name, name, 3, "mean") for name in names)]


def rows_of(method: str, several: Sequence[Mapping[str, Any]]) -> list[dict[str, Cell]]:
    """A row of each frame, with the IoU of each seed."""
    found: list[dict[str, Cell]] = []
    for frame in several[0]["held_out_maps"] if several else ():
        row: dict[str, Cell] = {"method": method, "frame": int(frame)}
        for name in several[0]["held_out_maps"][frame]:
            values = [value for scores in several if (value := scores["held_out_maps"][frame][name]) is not None]
            row[name] = values or None
        found.append(row)
    return found
