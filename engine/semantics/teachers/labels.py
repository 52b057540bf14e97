"""The teacher that reads annotated label maps: class index → text vector of the class name."""

from __future__ import annotations

import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.errors import ClipError
from degense.engine.semantics.teachers.teacher import Targets
from degense.engine.semantics.text.encoder import TextEncoder


class LabelTeacher:
    """Targets from the label maps beside a clip.

    Label maps of held-out frames are never used, except that a clip with a single label map trains on that one wherever it lies.
    "background" is a class like any other: a black border that an annotator labelled carries the background's own vector,
    so that "background" can be prompted and competes in argmax. Pixels outside `clip.valid` and unlabelled pixels carry nothing.
    `encoder` is extended with the clip's class names: `self.encoder` is the one to keep with the run.

    Raises
    ------
    ClipError
        If the clip has no label maps, or only on held-out frames.
    """

    name = "labels"
    pixelwise = True

    def __init__(self, clip: Clip, encoder: TextEncoder):
        labelled = clip.labelled_frames
        if not labelled:
            raise ClipError(f"Clip '{clip.name}' has no label maps; add labels/ and classes.json, or train without a teacher.")
        held_out = set(clip.test_frames)
        self.frames = labelled if len(labelled) == 1 else [frame for frame in labelled if frame not in held_out]
        if not self.frames:
            raise ClipError(
                f"All label maps of clip '{clip.name}' ({len(labelled)}) lie on held-out frames (1, 9, 17, …); label another frame."
            )
        self.encoder = encoder.with_classes(clip.classes)
        self.vectors = self.encoder.encode(clip.classes)
        self._clip = clip
        source = clip.provenance.get("labels", "label maps")
        used = f"{len(self.frames)} of {len(labelled)} label maps, {len(clip.classes)} classes"
        self.provenance = f"{source}: {used}, encoder {self.encoder.name}"

    def targets(self, frame: int) -> Targets | None:
        """The vectors of all classes float32 [k, D], and the index map int32 [H, W]; None for frames without a label map to learn from.

        Raises
        ------
        ClipError
            If the label map holds a value that `classes` does not name.
        """
        if frame not in self.frames:
            return None
        labels = self._clip.labels(frame)
        if labels is None:
            return None
        index = labels.astype(np.int32)
        index[(labels == UNLABELLED) | ~self._clip.valid(frame)] = -1
        if index.max(initial=-1) >= len(self.vectors):
            found = f"holds value {index.max()}, but there are {len(self.vectors)} classes"
            raise ClipError(f"The label map of frame {frame} of clip '{self._clip.name}' {found}; correct it or classes.json.")
        return self.vectors, index
