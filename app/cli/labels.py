"""`degense annotate` and `degense import`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.annotate.label_sets import label_format, names_of, open_annotations, write_labels
from degense.app.session.session_file import clip_folder
from degense.app.session.state_folder import held, saved_in
from degense.engine.annotation.edits import LabelClass, check_classes, merged, named_classes
from degense.engine.annotation.folder import NAME, save
from degense.engine.annotation.formats import MapSet
from degense.engine.annotation.label_png import read_label_png
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError
from degense.engine.files import write_text

if TYPE_CHECKING:
    from degense.engine.annotation.edits import Proposal
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene


#: The class of what no labelled frame shows, where it is to have one.
UNKNOWN = "unknown"


class Subject:
    """A run or a clip, and the folder of its annotations."""

    def __init__(self, path: Path):
        self.scene: Scene | None = None
        self.clip: Clip
        if (path / "run.json").is_file():
            from degense.engine.scene import Scene

            self.scene = Scene.open(path)
            if self.scene.clip is None:
                raise DegenseError(f"Labels are propagated along the recording, which is missing: {self.scene.clip_missing}.")
            self.clip, self.session = self.scene.clip, path
            self.folder = saved_in(path) / NAME
        else:
            from degense.engine.data.readers import open_clip

            self.clip = open_clip(path)
            self.session = clip_folder(self.clip.path)
            self.folder = saved_in(self.session)
        self.work = open_annotations(self.folder, self.scene, self.clip)
        self.names = names_of(self.clip, len(self.clip))


def annotate(options: argparse.Namespace) -> None:
    from degense.engine.annotation.propagation.propagate import propagate

    if options.out is None and not options.review:
        raise DegenseError("Say where the labels go: --out PATH, or --review to look at them in the window.")
    if len(options.labels) != len(options.frame):
        raise DegenseError("Give a --frame with each --labels: the number of the frame that the label map is of, from 0.")
    subject = Subject(options.path)
    work = subject.work
    if options.labels:
        given = {frame: read_label_png(path, work.shape) for path, frame in zip(options.labels, options.frame, strict=True)}
        if beyond := [frame for frame in given if not 0 <= frame < work.count]:
            raise DegenseError(f"There is no frame {beyond[0]}; the frames of {subject.clip.name} are 0 to {work.count - 1}.")
        work.classes = _enough_classes(work.classes, given.values())
        work.replace_labels(given, "from the command line")
    sources = {frame: work.labels(frame) for frame in work.sources() or subject.clip.labelled_frames}
    proposals = run_steps(propagate(subject.clip, sources, subject.scene), Bar())
    if options.out is not None:
        print(_write(subject, options.format, sources, proposals, options.out, options.unknown))
    if options.review:
        work.propose(proposals, options.replace)
        with held(subject.session):
            save(work, subject.folder)
        print(f"{subject.folder}: {len(work.waiting())} proposals to accept or reject in the window")


def _enough_classes(classes: tuple[LabelClass, ...], maps: Iterable[np.ndarray]) -> tuple[LabelClass, ...]:
    """Classes for all values that occur; those without a name are called by their value."""
    used = {int(value) for labels in maps for value in np.unique(labels)} - {UNLABELLED}
    return (*classes, *named_classes(f"label {value}" for value in range(max(used, default=-1) + 1))[len(classes) :])


def _write(
    subject: Subject, name: str, sources: dict[int, np.ndarray], proposals: dict[int, Proposal], out: Path, name_unknown: bool
) -> str:
    work, classes, unknown = subject.work, subject.work.classes, UNLABELLED
    if name_unknown:
        if any((labels == UNLABELLED).any() for labels in sources.values()):
            raise DegenseError("What is unknown can be named where the labelled frames are labelled throughout; label all of their pixels.")
        names = [kind.name for kind in classes]
        if UNKNOWN not in names:
            names.append(UNKNOWN)
            classes = (*classes, named_classes(names)[-1])
            check_classes(classes)
        unknown = names.index(UNKNOWN)

    def read(frame: int) -> np.ndarray:
        labels = sources[frame] if frame in sources else proposals[frame].labels
        return np.where(labels == UNLABELLED, np.uint8(unknown), labels)

    maps = MapSet(classes, work.shape, subject.names, tuple(sorted({*sources, *proposals})), read)
    words = run_steps(write_labels(name, maps, out), Bar())
    beside = out / "confidence.json" if out.is_dir() else out.with_name(f"{out.name}.confidence.json")
    confidence = {subject.names[frame]: round(found.confidence, 4) for frame, found in sorted(proposals.items())}
    write_text(beside, json.dumps(confidence, indent=1))
    sure = np.mean([found.confidence for found in proposals.values()]) if proposals else 1.0
    return f"{words}; from {len(sources)} labelled frames, mean confidence {sure:.0%} (confidence.json)"


def import_labels(options: argparse.Namespace) -> None:
    subject = Subject(options.path)
    maps = label_format(options.format).read(options.file, subject.work.shape, subject.names)
    classes, table = merged(subject.work.classes, maps.classes)
    subject.work.classes = classes
    subject.work.replace_labels({frame: table[maps.read(frame)] for frame in maps.frames}, options.file.name)
    with held(subject.session):
        save(subject.work, subject.folder)
    print(f"{subject.folder}: label maps of {len(maps.frames)} frames, {len(classes)} classes")
