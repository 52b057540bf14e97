"""A movie along a camera path: what the session shows, from where the camera stands, at the instants it passes."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from degense.app.features.cameras.state import CameraPath, Stop
from degense.app.features.viewer.layer_images import Movie, get_layer
from degense.app.features.viewer.view_rendering import View, ViewRequest, draw_view
from degense.app.session.view_state import ViewState
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps
from degense.widgets.splats.camera_moves import letterboxed

if TYPE_CHECKING:
    from degense.engine.scene import Scene

FPS = 25.0


def camera_movie(
    scene: Scene, stops: tuple[Stop, ...], view_state: ViewState, out: Path, fps: float = FPS, size: tuple[int, int] | None = None
) -> Steps[str]:
    """Write an .mp4 of `size` (width, height; None for the clip's) along the stops. Yields (fraction, words).

    Raises
    ------
    DegenseError
        With fewer than two stops, another suffix, or a layer that the scene cannot show from elsewhere.
    """
    if out.suffix.lower() != ".mp4":
        raise DegenseError(f"{out} must end in .mp4.")
    path, layer = CameraPath(stops), get_layer(view_state.layer)
    view_state = replace(view_state, compare="off")
    span = None
    if layer.kind == "scalar":
        yield 0.0, "finding the range of the whole sequence"
        span = _span(scene, view_state)
    count = max(2, round(path.seconds * FPS) + 1)
    with Movie(out, FPS) as movie:
        for i in range(count):
            yield i / count, f"frame {i + 1} of {count}"
            camera, frame = path.at(i / FPS)
            camera = letterboxed(camera, *scene.clip_size)
            request = ViewRequest(min(frame, scene.frames - 1.0), view_state, span, splats=False, camera=camera)
            movie.add(flat(_last(draw_view(scene, request)), view_state.overlay_opacity))
    return f"{out}: {count} frames along {len(stops)} cameras"


def flat(view: View, opacity: float) -> np.ndarray:
    """A view with its masks laid over it, uint8 [H, W, 3]."""
    if view.masks is None:
        return view.rgb
    alpha = view.masks[..., 3:].astype(np.float32) / 255 * opacity
    return (view.rgb * (1 - alpha) + view.masks[..., :3] * alpha + 0.5).astype(np.uint8)


def _span(scene: Scene, view_state: ViewState) -> tuple[float, float]:
    from degense.app.features.viewer.view_rendering import layer_request
    from degense.engine.layers import layer_range

    chosen = view_state.range(view_state.layer)
    if chosen.mode == "fixed":
        return chosen.low, chosen.high
    return layer_range(scene, get_layer(view_state.layer), layer_request(view_state, 0), "sequence", chosen.clip)


def _last(steps: Generator[View, None, View]) -> View:
    """The finished view of `draw_view`."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
