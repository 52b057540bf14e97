"""Sources of label maps (masks of a run, annotations), and writing them in formats of other tools. No Qt."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from degense.app.session.state_folder import saved_in
from degense.engine.annotation.annotations import Annotations
from degense.engine.annotation.edits import named_classes
from degense.engine.annotation.folder import NAME, load
from degense.engine.annotation.formats import LABEL_FORMATS, LabelFormat, MapSet
from degense.engine.errors import DegenseError, PromptError
from degense.engine.files import replacing_folder
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene
    from degense.engine.semantics.prompts import PromptSet


def names_of(clip: Clip | None, count: int) -> tuple[str, ...]:
    """What files of the frames are called; numbers where the recording is missing."""
    from degense.engine.data.readers import frame_names

    return frame_names(clip) if clip is not None else tuple(f"{index:06d}" for index in range(count))


def label_format(name: str) -> LabelFormat:
    """The format of that name; DegenseError, with those there are, when there is none."""
    if name not in LABEL_FORMATS:
        raise DegenseError(f"There is no format {name!r} for labels; choose one of {', '.join(LABEL_FORMATS)}.")
    return LABEL_FORMATS[name]


def label_source(scene: Scene, source: str | None, prompts: PromptSet) -> MapSet:
    """The label maps of a run: see `ExportOptions.source`. DegenseError when there are none."""
    if source == "annotations" or (source is None and not prompts.prompts):
        width, height = scene.clip_size
        work = load(saved_in(scene.run.path) / NAME, (height, width), scene.frames, scene.labels)
        if work is not None:
            return annotated(work, scene.clip)
        if source == "annotations":
            raise DegenseError(f"{scene.name} has no annotations; annotate it in the window, or export the masks of prompts.")
    return masks_of_run(scene, prompts)


def open_annotations(folder: Path, scene: Scene | None, clip: Clip | None) -> Annotations:
    """The annotations saved in a folder of a run or clip, else empty ones with its classes. Errors as `load`."""
    labels: Callable[[int], np.ndarray | None]
    if scene is not None:
        (width, height), count, labels = scene.clip_size, scene.frames, scene.labels
    else:
        assert clip is not None
        (width, height), count, labels = clip.size, len(clip), clip.labels
    names = (clip.classes if clip is not None else ()) or (scene.classes if scene is not None else ())
    return load(folder, (height, width), count, labels) or Annotations(named_classes(names), (height, width), count, labels)


def annotated(work: Annotations, clip: Clip | None) -> MapSet:
    """The label maps that were made or accepted, and those that the clip came with."""
    made = {frame for frame, record in work.records.items() if record.labels is not None}
    frames = tuple(sorted(made.union(clip.labelled_frames if clip is not None else ())))
    return MapSet(work.classes, work.shape, names_of(clip, work.count), frames, work.labels)


def masks_of_run(scene: Scene, prompts: PromptSet) -> MapSet:
    """The labels of prompts in every frame, or of the scene's classes when nothing is prompted."""
    from degense.engine.scene.clip_query import decode_frame, encode_prompts

    classes = prompts.prompts or scene.classes
    if not classes:
        raise PromptError(f"{scene.name} has no classes of its own; say which masks to export with prompts.")
    asked = replace(prompts, prompts=classes)
    encode_prompts(scene, asked)  # an unknown prompt is refused before anything is written
    width, height = scene.clip_size

    def read(frame: int) -> np.ndarray:
        return decode_frame(scene, asked, frame).labels

    return MapSet(named_classes(classes), (height, width), names_of(None, scene.frames), tuple(range(scene.frames)), read)


def write_labels(name: str, maps: MapSet, out: Path) -> Steps[str]:
    """Write label maps; returns a summary in one sentence. DegenseError when they cannot be written."""
    chosen = label_format(name)
    if not maps.frames:
        raise DegenseError("None of these frames is labelled, so there is nothing to export.")
    with nullcontext(out) if chosen.suffix else replacing_folder(out) as place:
        for done, frame in enumerate(chosen.write(maps, place), 1):
            yield min(0.99, done / len(maps.frames)), f"frame {frame}"
    return f"{out}: {counted(len(maps.frames), 'label map')} of {counted(len(maps.classes), 'class', 'classes')}"


def counted(count: int, one: str, more: str = "") -> str:
    """A number with its noun."""
    return f"{count} {one if count == 1 else more or one + 's'}"


def at_frames(maps: MapSet, wanted: Iterable[int]) -> MapSet:
    """The label maps of these frames, as far as there are any."""
    return replace(maps, frames=tuple(sorted(set(maps.frames).intersection(wanted))))
