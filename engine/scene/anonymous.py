"""A scene that may be shown to others: without names of files and people, and with a region of the picture blacked out."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.clip import Clip, Truth
from degense.engine.data.files.images import read_index
from degense.engine.errors import DegenseError
from degense.engine.raster import rasterize
from degense.engine.scene.renderer import Renderer
from degense.engine.scene.scene import Scene
from degense.engine.semantics.masks import FrameSemantics, query_of
from degense.engine.store import Run

#: What takes the place of the names of a run and of a clip.
RUN_NAME, CLIP_NAME = "run", "clip"
LEFT_OUT = "left out, because it is anonymised"
#: Formats that hold the Gaussians themselves.
HOLD_GAUSSIANS = ("ply", "spz", "gltf", "ply-sequence")
NOT_COVERED = "Gaussians cannot be covered; train the clip with the text outside of its masks, or write a movie or pictures instead."


def read_cover(path: Path, size: tuple[int, int]) -> np.ndarray:
    """The region to black out, bool [H, W]: a grey picture of a clip's (width, height), not 0 where text is. ClipError, DegenseError."""
    cover = read_index(path) > 0
    if cover.shape[::-1] != size:
        raise DegenseError(f"{path.name} is {cover.shape[1]} × {cover.shape[0]} pixels, but the clip is {size[0]} × {size[1]}.")
    return cover


def anonymised(scene: Scene, cover: np.ndarray | None = None) -> Scene:
    """The same scene by a neutral name, with the recording as `AnonymousClip`, and `cover` bool [H, W] left empty in all that is drawn.

    With a cover nothing is drawn from another camera than the surgeon's: DegenseError then. Its Gaussians are those of the scene.
    """
    other = copy.copy(scene)
    teacher = str(scene.run.info.get("teacher", {}).get("name") or "none").partition(":")[0]
    hidden = {"clip": {"name": CLIP_NAME, "path": "."}, "teacher": {"name": teacher, "provenance": teacher}, "provenance": {}}
    other.run = Run(scene.run.path, {**scene.run.info, **hidden})
    other.name, other.clip_missing = RUN_NAME, "it is left out"
    other.clip = AnonymousClip(scene.clip, cover) if scene.clip is not None else None
    other.renderer = _CoveredRenderer(scene, cover)
    other.render, other.render_rgb = other.renderer.render, other.renderer.render_rgb
    return other


def anonymous_scores(scores: dict[str, Any]) -> dict[str, Any]:
    """Scores of `engine.metrics.evaluate` without the names of run and clip, and without where the poses come from."""
    return scores | {"run": RUN_NAME, "clip": CLIP_NAME, "poses": LEFT_OUT}


class AnonymousClip(Clip):
    """A clip whose files have no names, and whose frames are black under a cover bool [H, W]."""

    def __init__(self, clip: Clip, cover: np.ndarray | None) -> None:
        provenance = dict.fromkeys(clip.provenance, LEFT_OUT)
        super().__init__(CLIP_NAME, Path(CLIP_NAME), clip.cameras, clip.classes, provenance, clip.unit, clip.fps, {}, clip.poses)
        self._clip, self._cover = clip, cover

    @property
    def labelled_frames(self) -> list[int]:
        return self._clip.labelled_frames

    @property
    def stroked_frames(self) -> list[int]:
        return self._clip.stroked_frames

    @property
    def depth_measured(self) -> bool:
        return self._clip.depth_measured

    def frame(self, index: int) -> np.ndarray:
        frame = self._clip.frame(index).copy()
        if self._cover is not None:
            frame[self._cover] = 0
        return frame

    def valid(self, index: int) -> np.ndarray:
        return self._clip.valid(index)

    def depth(self, index: int) -> np.ndarray:
        return self._clip.depth(index)

    def labels(self, index: int) -> np.ndarray | None:
        return self._clip.labels(index)

    def strokes(self, index: int) -> np.ndarray | None:
        return self._clip.strokes(index)

    def truth(self) -> Truth | None:
        return self._clip.truth()


class _CoveredRenderer(Renderer):
    """Draws nothing under the cover: there everything is as where no Gaussian is."""

    def __init__(self, scene: Scene, cover: np.ndarray | None) -> None:
        super().__init__(RUN_NAME, scene.states, scene.basis, scene.camera)
        self.curve, self.labelled, self._cover = scene.renderer.curve, scene.renderer.labelled, cover
        self.only_surgeons = cover is not None

    def draw(self, frame: float, camera: Camera, what: tuple[str, ...]) -> dict[str, np.ndarray]:
        drawn = super().draw(frame, camera, what)
        if self._cover is not None:
            self._check(frame, camera)
            for name, values in drawn.items():
                values[self._cover] = 0 if name in ("alpha", "rgb", "latent") else np.nan
        return drawn

    def blend(self, name: str, frame: float, values: Callable[[], Tensor], camera: Camera | None = None) -> np.ndarray:
        blended = super().blend(name, frame, values, camera)
        if self._cover is None:
            return blended
        self._check(frame, camera or self.camera_at(frame))
        return np.where(self._cover, np.float32(np.nan), blended)

    @torch.no_grad()
    def new_query(self, frame: float, camera: Camera) -> FrameSemantics:
        if self._cover is None or self.basis is None:
            return super().new_query(frame, camera)
        self._check(frame, camera)
        splats = self.states.splats(frame, semantics=True)
        drawn = rasterize(splats, torch.cat([splats.colors, splats.semantics], 1), camera, clean=True)
        shown = ~torch.from_numpy(self._cover).to(drawn.image.device)
        return query_of(
            replace(drawn, image=drawn.image * shown[..., None], alpha=drawn.alpha * shown),
            self.basis,
            self.curve,
            self.known(frame, camera),
        )

    def _check(self, frame: float, camera: Camera) -> None:
        if camera is not self.camera_at(frame):
            raise DegenseError("What is burnt into the picture can be covered only as the surgeon's camera sees it; leave out --cover.")
