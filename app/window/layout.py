"""How the window is arranged for a run: panels, the share of the views, and where the free camera stands."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QByteArray

from app.camera_book import camera_from_json, camera_to_json
from app.part import Part
from app.session import Session
from app.window.drawing import Drawing
from app.window.parts import Parts
from engine.camera import Camera
from engine.errors import RunError

LONGEST = 1 << 16


class WindowLayout(Part):
    """Saved with each run; a run without one leaves the window as it is."""

    counts = False

    def __init__(self, session: Session, parts: Parts, drawing: Drawing) -> None:
        super().__init__()
        self.session, self.parts = session, parts
        self._camera: Camera | None = None
        drawing.shown.connect(self._put_camera)

    def clear(self) -> None:
        self._camera = None

    def to_json(self) -> Any:
        splats = self.parts.splats
        free = splats is not None and self.session.camera_mode == "free" and not splats.is_locked()
        return {
            "docks": bytes(self.parts.window.saveState().toBase64().data()).decode("ascii"),
            "views": self.parts.views.sizes(),
            "camera": camera_to_json(splats.camera()) if free and splats is not None else None,
        }

    def from_json(self, data: Any, source: str) -> None:
        try:
            docks, views = str(data["docks"]).encode("ascii")[:LONGEST], [min(1 << 15, max(0, int(size))) for size in data["views"]]
            self._camera = None if data["camera"] is None else camera_from_json(data["camera"])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not hold the layout of a window ({error}).") from error
        self.parts.window.restoreState(QByteArray.fromBase64(docks))
        if self.parts.views.count() == len(views):
            self.parts.views.setSizes(views)

    def _put_camera(self) -> None:
        """Set the free camera as soon as there are splats to see."""
        splats = self.parts.splats
        if self._camera is None or splats is None or splats.isHidden():
            return
        if self.session.camera_mode == "free":
            splats.set_free_camera(self._camera)
        self._camera = None
