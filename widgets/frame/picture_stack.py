"""The pictures that lie on each other in a panel, and how they are held against what was observed."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from PySide6.QtCore import QRectF
from PySide6.QtGui import QImage, QPainter

from degense.widgets.frame.images import to_array, to_qimage

COMPARE_MODES = ("off", "wipe", "blink", "difference")


class Picture(NamedTuple):
    """An image as it came, and as Qt draws it."""

    rgb: np.ndarray
    drawn: QImage

    @staticmethod
    def of(rgb: np.ndarray | None) -> Picture | None:
        return None if rgb is None else Picture(rgb, to_qimage(rgb))


class PictureStack:
    """A picture, an overlay above it, and the observed frame beside, in turns with, or subtracted from it.

    Attributes
    ----------
    mode : str
        One of `COMPARE_MODES`.
    split : float
        Place of the wipe line: the picture left of this fraction of its width, the observed frame right of it.
    blinked : bool
        Whether it is the observed frame's turn while blinking.
    """

    def __init__(self) -> None:
        self.image: Picture | None = None
        self.observed: Picture | None = None
        self.overlay: QImage | None = None
        self.overlay_opacity = 1.0
        self.labels: QImage | None = None
        self.mode = "off"
        self.split = 0.5
        self.gain = 4.0
        self.blinked = False
        self._difference: QImage | None = None

    def set_image(self, rgb: np.ndarray | None) -> None:
        self.image, self._difference = Picture.of(rgb), None

    def set_observed(self, rgb: np.ndarray | None) -> None:
        self.observed, self._difference = Picture.of(rgb), None

    def set_labels(self, rgba: np.ndarray | None) -> None:
        """Lay a label map uint8 [H, W, 4] above the overlay."""
        self.labels = None if rgba is None else to_qimage(rgba)

    def patch_labels(self, rgba: np.ndarray, left: int, top: int) -> None:
        """Replace a part, uint8 [h, w, 4], of the label map that is shown."""
        if self.labels is not None:
            with QPainter(self.labels) as painter:
                painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
                painter.drawImage(left, top, to_qimage(rgba))

    def set_gain(self, gain: float) -> None:
        self.gain, self._difference = gain, None

    def compares(self, mode: str) -> bool:
        """Whether this comparison is being shown: it is chosen, and there is something to compare with."""
        return self.mode == mode and self.observed is not None and self.image is not None

    def paint(self, painter: QPainter, target: QRectF) -> None:
        """Paint everything into `target`; the picture must be there."""
        assert self.image is not None
        if self.compares("blink") and self.blinked:
            assert self.observed is not None
            painter.drawImage(target, self.observed.drawn)
            return
        painter.drawImage(target, self._subtracted() if self.compares("difference") else self.image.drawn)
        if self.overlay is not None and self.overlay_opacity > 0:
            painter.setOpacity(self.overlay_opacity)
            painter.drawImage(target, self.overlay)
            painter.setOpacity(1.0)
        if self.labels is not None:
            painter.drawImage(target, self.labels)
        if self.compares("wipe"):
            assert self.observed is not None
            painter.save()
            right = QRectF(target)
            right.setLeft(target.left() + self.split * target.width())
            painter.setClipRect(right)
            painter.drawImage(target, self.observed.drawn)
            painter.restore()

    def grab(self) -> np.ndarray:
        """What is shown, uint8 [H, W, 3], at the picture's own resolution. ValueError without a picture."""
        if self.image is None:
            raise ValueError("there is no picture to grab")
        canvas = QImage(self.image.drawn.size(), QImage.Format.Format_RGB32)
        with QPainter(canvas) as painter:
            self.paint(painter, QRectF(canvas.rect()))
        return to_array(canvas)

    def _subtracted(self) -> QImage:
        assert self.image is not None
        assert self.observed is not None
        if self._difference is None:
            height, width = self.observed.rgb.shape[:2]
            shown = self.image.rgb if self.image.rgb.shape[:2] == (height, width) else cv2.resize(self.image.rgb, (width, height))
            difference = np.abs(shown.astype(np.int16) - self.observed.rgb)
            self._difference = to_qimage(np.minimum(difference * np.float32(self.gain), 255.0).astype(np.uint8))
        return self._difference
