"""A movie along a camera path: what the session shows, from where the camera stands, at the instants it passes."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from degense.app.features.cameras.state import CameraPath, Stop
from degense.app.features.viewer.layer_images import get_layer, laid_over, movie, sequence_span
from degense.app.features.viewer.view_rendering import View, ViewRequest, draw_view, layer_request
from degense.app.session.view_state import ViewState
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps
from degense.widgets.splats.camera_moves import filled

if TYPE_CHECKING:
    from degense.engine.scene import Scene

FPS = 25.0


def camera_movie(scene: Scene, stops: tuple[Stop, ...], view_state: ViewState, out: Path) -> Steps[str]:
    """Write an .mp4 of the clip's size along the stops. Yields (fraction, words).

    DegenseError with fewer than two stops, another suffix, or a layer that the scene cannot show from elsewhere.
    """
    if out.suffix.lower() != ".mp4":
        raise DegenseError(f"{out} must end in .mp4.")
    path, layer = CameraPath(stops), get_layer(view_state.layer)
    view_state = replace(view_state, compare="off")
    chosen = view_state.range(view_state.layer)
    fixed = (chosen.low, chosen.high) if chosen.mode == "fixed" else None
    span = yield from sequence_span(scene, layer, layer_request(view_state, 0), fixed, chosen.clip)
    count = max(2, round(path.seconds * FPS) + 1)
    with movie(out, FPS) as add:
        for i in range(count):
            yield i / count, f"frame {i + 1} of {count}"
            camera, frame = path.at(i / FPS)
            camera = filled(camera, *scene.clip_size)
            request = ViewRequest(min(frame, scene.frames - 1.0), view_state, span, splats=False, camera=camera)
            view = _last(draw_view(scene, request))
            add(view.rgb if view.masks is None else laid_over(view.rgb, view.masks, view_state.overlay_opacity))
    return f"{out}: {count} frames along {len(stops)} cameras"


def _last(steps: Generator[View, None, View]) -> View:
    """The finished view of `draw_view`."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
