"""Exports in every format that takes seconds, each read back by what reads it."""

from __future__ import annotations

import random
from pathlib import Path
from typing import TYPE_CHECKING

from degense.app.research.reliability.kills.program import Killed
from degense.app.research.reliability.kills.whole import SHARED, Expected, check_whole
from degense.engine.progress import finish

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: All but a data set whose classes the sample has not.
EXPORTS = (
    *("ply", "spz", "gltf", "ply-sequence", "movie", "masks-png", "coco", "cvat", "cvat-video", "label-studio", "yolo"),
    *("nifti", "seg-nrrd", "dicom-seg", "cholecseg8k", SHARED),
)
FRAMES = 2


def work(folder: Path) -> None:
    """One format after the other, always in another order so that each is met by a kill."""
    from degense.engine.scene import Scene

    scene = Scene.open(folder / "run", device="cpu")
    (folder / "out").mkdir(exist_ok=True)
    for number in range(100):
        for name in random.sample(EXPORTS, len(EXPORTS)):
            export(scene, name, folder / "out" / f"{number}-{name}{suffix(name)}")


def suffix(name: str) -> str:
    from degense.app.features.export.formats import FORMATS

    return ".html" if name == SHARED else FORMATS[name].suffix


def export(scene: Scene, name: str, out: Path) -> None:
    from degense.app.features.export.formats import FORMATS, ExportOptions
    from degense.app.features.share.page import share
    from degense.engine.semantics.prompts import PromptSet

    prompts = PromptSet.chosen(["liver"], None, None)
    if name == SHARED:
        finish(share(scene, out, prompts))
    else:
        finish(FORMATS[name].export(scene, out, ExportOptions(prompts, frames=range(FRAMES), source="masks")))


def begun(folder: Path) -> bool:
    return any(_finished(folder))


def _finished(folder: Path) -> list[Path]:
    """What has its final name."""
    return [path for path in (folder / "out").glob("*") if not path.name.startswith(".")]


def check(folder: Path, killed: Killed) -> None:
    from degense.engine.scene import Scene

    scene = Scene.open(folder / "run", device="cpu")
    width, height = scene.clip_size
    for path in _finished(folder):
        check_whole(path.name.partition("-")[2].partition(".")[0], path, Expected((height, width), scene.frames, FRAMES))
