"""What is left out of what is handed over. No Qt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from degense.app.features.annotate.label_sets import names_of
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.annotation.formats import MapSet
    from degense.engine.camera import Camera
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene


@dataclass(frozen=True, eq=False)
class Anonymity:
    """Whether names and sources are left out, and which pixels are black then, bool [H, W]; None: none are."""

    on: bool = False
    cover: np.ndarray | None = None

    @property
    def covering(self) -> bool:
        return self.on and self.cover is not None

    def scene(self, scene: Scene) -> Scene:
        """The scene as it may be shown."""
        if not self.on:
            return scene
        from degense.engine.scene.anonymous import anonymised

        return anonymised(scene, self.cover)

    def clip(self, clip: Clip) -> Clip:
        """The clip as it may be shown."""
        if not self.on:
            return clip
        from degense.engine.scene.anonymous import AnonymousClip

        return AnonymousClip(clip, self.cover)

    def maps(self, maps: MapSet) -> MapSet:
        """Label maps with numbers in place of the names of the frames' files."""
        return replace(maps, names=names_of(None, len(maps.names))) if self.on else maps

    def name(self, name: str) -> str:
        """What a file is called at first, of which `name` is the usual name."""
        from degense.engine.scene.anonymous import RUN_NAME

        return RUN_NAME if self.on else name

    def picture(self, draw: Callable[[], np.ndarray]) -> Callable[[], np.ndarray]:
        """A picture of the surgeon's camera, uint8 [H, W, 3], with what is covered in black."""

        def covered() -> np.ndarray:
            drawn = draw()
            if self.cover is None or not self.on:
                return drawn
            if drawn.shape[:2] != self.cover.shape:
                raise DegenseError("The picture has another size than what is blacked out; black it out anew.")
            return np.where(self.cover[..., None], np.uint8(0), drawn)

        return covered

    def check_camera(self, camera: Camera, surgeon: Camera) -> None:
        """DegenseError when something is covered that another camera shows elsewhere."""
        if self.covering and camera is not surgeon:
            raise DegenseError("What is burnt in can be covered only as the surgeon's camera sees it; press V to go back to it first.")
