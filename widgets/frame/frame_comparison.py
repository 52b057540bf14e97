"""A render compared with the recorded frame: side by side at a wipe line, in turns, or as their difference."""

from __future__ import annotations

import cv2
import numpy as np
from PySide6.QtCore import QObject, QRectF, QTimer
from PySide6.QtGui import QImage, QPainter
from PySide6.QtWidgets import QWidget

from degense.widgets.qt_images import DrawableFrame, to_qimage

COMPARE_MODES = ("off", "wipe", "blink", "difference")

#: How long each of the two frames is shown while they blink, milliseconds, and how many times as bright differences are shown.
BLINK_MS, GAIN = 500, 4


class Comparison(QObject):
    """Paints the render of a panel compared with the frame that was observed."""

    def __init__(self, panel: QWidget) -> None:
        super().__init__(panel)
        self._panel = panel
        self.mode = "off"  # one of `COMPARE_MODES`
        self.split = 0.5  # place of the wipe line: the render left of this fraction of the width, the observed frame right of it
        self.observed: DrawableFrame | None = None  # the recorded frame; without it nothing is compared
        self._observed_turn = False
        self._difference: tuple[DrawableFrame, QImage] | None = None
        self._timer = QTimer(self, interval=BLINK_MS)
        self._timer.timeout.connect(self._blink)

    def set_observed(self, rgb: np.ndarray | None) -> None:
        """The recorded frame, uint8 [H, W, 3], to compare with."""
        self.observed, self._difference = DrawableFrame.of(rgb), None
        self._panel.update()

    def set_mode(self, mode: str) -> None:
        """One of `COMPARE_MODES`; ValueError for another."""
        if mode not in COMPARE_MODES:
            raise ValueError(f"unknown comparison {mode!r}; there are {', '.join(COMPARE_MODES)}")
        if mode != self.mode:
            self.mode, self._observed_turn = mode, False
            self._timer.start() if mode == "blink" else self._timer.stop()
        self._panel.update()

    def set_split(self, split: float) -> None:
        """Place the wipe line, 0 at the left and 1 at the right."""
        self.split = min(max(split, 0.0), 1.0)
        self._panel.update()

    def shows(self, mode: str) -> bool:
        """Whether this comparison is shown: it is chosen, and there is something to compare with."""
        return self.mode == mode and self.observed is not None

    def note(self) -> str:
        """What the panel says about the comparison; empty where it can be seen."""
        if self.mode == "off":
            return ""
        if self.observed is None:
            return "no observed frame to compare with"
        if self.mode == "blink":
            return "observed" if self._observed_turn else "reconstruction"
        return f"difference × {GAIN}" if self.mode == "difference" else ""

    def paint_alone(self, painter: QPainter, target: QRectF) -> bool:
        """Paint the observed frame when it is its turn to blink; whether it was."""
        if self.shows("blink") and self._observed_turn and self.observed is not None:
            painter.drawImage(target, self.observed.drawn)
            return True
        return False

    def base(self, render: DrawableFrame) -> QImage:
        """What is painted below the overlays: the render, or its difference from the observed frame."""
        return self._subtracted(render, self.observed) if self.mode == "difference" and self.observed is not None else render.drawn

    def paint_wiped(self, painter: QPainter, target: QRectF) -> None:
        """Paint the observed frame right of the wipe line."""
        if self.shows("wipe") and self.observed is not None:
            painter.save()
            painter.setClipRect(target.adjusted(self.split * target.width(), 0, 0, 0))
            painter.drawImage(target, self.observed.drawn)
            painter.restore()

    def _subtracted(self, render: DrawableFrame, observed: DrawableFrame) -> QImage:
        if self._difference is None or self._difference[0] is not render:
            height, width = observed.rgb.shape[:2]
            shown = render.rgb if render.rgb.shape[:2] == (height, width) else cv2.resize(render.rgb, (width, height))
            difference = np.abs(shown.astype(np.int16) - observed.rgb)
            self._difference = render, to_qimage(np.minimum(difference * np.float32(GAIN), 255.0).astype(np.uint8))
        return self._difference[1]

    def _blink(self) -> None:
        self._observed_turn = not self._observed_turn
        self._panel.update()
