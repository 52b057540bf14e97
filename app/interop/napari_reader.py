"""A reader for napari (`napari RUN`): a run as colours, masks of its classes, displacement and depth, each drawn when it is looked at."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.engine.colour_maps import CLASS_COLOURS
from degense.engine.layer_titles import with_unit

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: What napari calls a layer: data, attributes and kind.
LayerData = tuple["FrameStack", dict[str, Any], str]


class FrameStack:
    """Frames along the first axis that are drawn when they are asked for, with as much of an array as napari needs."""

    def __init__(self, count: int, first: np.ndarray, draw: Callable[[int], np.ndarray]) -> None:
        self.shape, self.dtype, self.ndim = (count, *first.shape), first.dtype, first.ndim + 1
        self._draw = draw

    def __len__(self) -> int:
        return int(self.shape[0])

    def __getitem__(self, key: Any) -> np.ndarray:
        time, *rest = key if isinstance(key, tuple) else (key,)
        if isinstance(time, slice):
            frames = np.stack([self._draw(index) for index in range(*time.indices(len(self)))])
            return np.asarray(frames[(slice(None), *rest)])
        return np.asarray(self._draw(range(len(self))[int(time)])[tuple(rest)])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self[:], dtype)


def get_reader(path: str | list[str]) -> Callable[[str], list[LayerData]] | None:
    """What reads a run folder; None for anything else."""
    return read_run if isinstance(path, str) and (Path(path) / "run.json").is_file() else None


def read_run(path: str) -> list[LayerData]:
    """The layers of a run. DegenseError when it is damaged."""
    from degense.engine.scene import Scene

    scene = Scene.open(Path(path))
    layers = [_layer(scene, scene.render_rgb, "image", name=f"{scene.name} colour", rgb=True)]
    for name in ("displacement", "depth"):
        about = {"name": with_unit(f"{scene.name} {name}", scene.unit), "colormap": "viridis", "visible": False}
        layers.append(_layer(scene, partial(_drawn, scene, name), "image", **about))
    if scene.has_semantics and scene.classes:
        colours = {k + 1: np.array([*colour, 255]) / 255 for k, colour in enumerate(CLASS_COLOURS)}
        about = {"name": f"{scene.name} masks", "visible": False, "features": {"class": ["nothing", *scene.classes]}}
        layers.append(_layer(scene, _classes(scene), "labels", **about, colormap=colours | {None: np.zeros(4)}))
    return layers


def _drawn(scene: Scene, name: str, frame: int) -> np.ndarray:
    return scene.render(frame, what=(name,))[name]


def _layer(scene: Scene, draw: Callable[[int], np.ndarray], kind: str, **about: Any) -> LayerData:
    return FrameStack(scene.frames, draw(0), draw), about, kind


def _classes(scene: Scene) -> Callable[[int], np.ndarray]:
    """The class of each pixel of a frame, uint8 [H, W]: 0 for nothing, else its number from 1."""
    from degense.engine.scene.clip_query import decode_frame
    from degense.engine.semantics.prompts import PromptSet

    asked = PromptSet(scene.classes)
    return lambda frame: decode_frame(scene, asked, frame).numbers
