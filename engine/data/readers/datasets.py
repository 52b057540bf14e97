"""What lies in a folder of many clips."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.stored import sampled
from degense.engine.data.readers.detect import clips_within, detect, is_clip, open_clip
from degense.engine.errors import ClipError

#: The clips of CholecSeg8k on which SurgTPGS and those who compare with it report; the data set has no official split.
SURGTPGS_TEST = ("video01_00080", "video01_00240", "video01_15019", "video12_15750", "video17_01803")
#: What EndoVis 2018 and those who keep it call the folder of the test sequences.
TEST_FOLDER = re.compile(r"test(ing)?([_ -]?(data|set|release))?([_ -]?\d+)?")


@dataclass(frozen=True)
class ClipEntry:
    """A clip of a data set."""

    path: Path
    layout: str  # as `detect` names it; "unknown" where that fails
    split: str  # "train" or "test", by the folders of EndoVis 2018 and by `SURGTPGS_TEST`; empty where nothing tells
    frames: int = 0  # their number
    test_frames: int = 0  # number of held-out frames, which are never trained on
    labelled: int = 0  # number of frames with a label map
    size: tuple[int, int] = (0, 0)  # (width, height)
    classes: tuple[str, ...] = ()  # those seen in a few of its label maps
    problem: str = ""  # why it cannot be opened, in one sentence; empty when it can


def list_clips(folder: Path) -> Iterator[ClipEntry]:
    """Every clip in a folder, opened and looked at, one after the other; a folder that is a clip lists itself.

    ClipError when there is none.
    """
    if not folder.is_dir():
        raise ClipError(f"{shown(folder)} is no folder; give the folder of a data set.")
    paths = [folder] if is_clip(folder) else clips_within(folder)
    if not paths:
        raise ClipError(f"{shown(folder)} holds no clips: no images/, no left_frames/, no frame_<number>_endo.png and no video.")
    for path in paths:
        yield look_at(path)


def look_at(path: Path) -> ClipEntry:
    """One clip; what is wrong with it stands in `problem`."""
    layout = "unknown"
    try:
        layout = detect(path)
        clip = open_clip(path)
        labelled = clip.labelled_frames
        seen: set[int] = set()
        for i in sampled(len(labelled)) if labelled else ():
            labels = clip.labels(labelled[i])
            assert labels is not None
            seen |= {int(value) for value in np.unique(labels[labels != UNLABELLED])}
    except ClipError as error:
        return ClipEntry(path, layout, _split(path, layout), problem=str(error))
    classes = tuple(clip.classes[value] for value in sorted(seen))
    return ClipEntry(path, layout, _split(path, layout), len(clip), len(clip.test_frames), len(labelled), clip.size, classes)


def _split(path: Path, layout: str) -> str:
    if layout == "cholecseg8k":
        return "test" if path.name in SURGTPGS_TEST else "train"
    if layout == "endovis18":
        return "test" if any(TEST_FOLDER.fullmatch(part.lower()) for part in path.parts[-4:-1]) else "train"
    return ""
