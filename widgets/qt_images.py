"""Frames and colours as numpy or plain values, and as Qt has them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from PySide6.QtGui import QColor, QImage


def to_qimage(pixels: np.ndarray) -> QImage:
    """A QImage that owns its pixels, from uint8 [H, W, 3] (RGB) or [H, W, 4] (RGBA, not premultiplied)."""
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise ValueError(f"an image is uint8 [H, W, 3 or 4], not {pixels.dtype} {list(pixels.shape)}")
    pixels = np.ascontiguousarray(pixels)
    height, width, channels = pixels.shape
    if channels == 3:
        image = QImage(pixels.data, width, height, 3 * width, QImage.Format.Format_RGB888)
        return image.convertToFormat(QImage.Format.Format_RGB32)
    image = QImage(pixels.data, width, height, 4 * width, QImage.Format.Format_RGBA8888)
    return image.convertToFormat(QImage.Format.Format_ARGB32_Premultiplied)


def to_array(image: QImage) -> np.ndarray:
    """RGB uint8 [H, W, 3] of a QImage."""
    image = image.convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    return rows[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).copy()


class DrawableFrame(NamedTuple):
    """A frame uint8 [H, W, 3], and the same as Qt draws it: converted once, however often it is painted."""

    rgb: np.ndarray
    drawn: QImage

    @staticmethod
    def of(rgb: np.ndarray | None) -> DrawableFrame | None:
        return None if rgb is None else DrawableFrame(rgb, to_qimage(rgb))


def rgb(colour: QColor) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255."""
    return colour.red(), colour.green(), colour.blue()
