"""The layout of the window for a run: panels, sizes of the views, the free camera, zoom and pan of the 2D view."""

from __future__ import annotations

import math
from typing import Any, Literal

from degense.app.features.viewer.controller import Viewer
from degense.app.session.camera_json import camera_from_json, camera_to_json
from degense.app.session.state import PersistentState
from degense.engine.camera import Camera
from degense.engine.errors import RunError, what_is_wrong

LONGEST = 1 << 16


class WindowLayout(PersistentState):
    """Saved with each run; a run without one leaves the window as it is."""

    counts = False

    def __init__(self, viewer: Viewer) -> None:
        super().__init__()
        self.viewer, self.session, self.docks = viewer, viewer.session, viewer.shell.docks
        self._camera: Camera | None = None
        self._zoom: tuple[float, float, float] | Literal["whole"] | None = None
        viewer.shown.connect(self._apply)

    def clear(self) -> None:
        self._camera = self._zoom = None

    def to_json(self) -> Any:
        splats = self.viewer.splats
        free = splats is not None and self.session.camera_mode == "free" and not splats.camera.is_locked()
        return {
            "docks": self.docks.state(),
            "views": self.docks.view_sizes(),
            "camera": camera_to_json(splats.camera.current()) if free and splats is not None else None,
            "picture": "whole" if self.viewer.panel.zoom.fitted else self.viewer.panel.zoom.view(),
        }

    def from_json(self, data: Any, source: str) -> None:
        try:
            docks, views = str(data["docks"])[:LONGEST], [min(1 << 15, max(0, int(size))) for size in data["views"]]
            self._camera = None if data["camera"] is None else camera_from_json(data["camera"])
            self._zoom = "whole" if data.get("picture", "whole") == "whole" else _view(*data["picture"])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not hold the layout of a window ({what_is_wrong(error)}).") from error
        self.docks.restore(docks)
        if self.docks.views.count() == len(views):
            self.docks.views.setSizes(views)

    def _apply(self) -> None:
        """Zoom and pan as soon as there is a frame, and set the free camera as soon as there are splats to see."""
        splats, panel = self.viewer.splats, self.viewer.panel
        if self._zoom == "whole":
            panel.zoom.fit()
        elif self._zoom is not None:
            panel.zoom.set_view(*self._zoom)
            panel.zoom.set_factor(panel.zoom.factor())  # moves it into sight
        self._zoom = None
        if self._camera is None or splats is None or splats.isHidden():
            return
        if self.session.camera_mode == "free":
            splats.camera.set_free(self._camera)
        self._camera = None


def _view(scale: float, x: float, y: float) -> tuple[float, float, float]:
    """A view as `RenderPanel.view` gives it. ValueError when it is none."""
    if not (0 < scale < math.inf and math.isfinite(x) and math.isfinite(y)):
        raise ValueError("not a zoom and a point of the image")
    return float(scale), float(x), float(y)
