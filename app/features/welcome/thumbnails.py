"""Small pictures of the clips and runs that were opened, kept in the user's cache folder."""

from __future__ import annotations

import hashlib
import logging
from pathlib import Path

import cv2
import numpy as np
import platformdirs
from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QImageReader, QPixmap

from degense.app.features.viewer.layer_images import write_png
from degense.engine.errors import DegenseError

log = logging.getLogger(__name__)

WIDTH, HEIGHT = 128, 84


def thumbnail_file(path: Path) -> Path:
    """Where the picture of a clip or run lies."""
    name = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:24]
    return Path(platformdirs.user_cache_dir("degense", appauthor=False)) / "thumbnails" / f"{name}.png"


def keep(path: Path, rgb: np.ndarray) -> None:
    """Keep a frame, uint8 [H, W, 3], as the picture of `path`; the log says where that is not possible."""
    height, width = rgb.shape[:2]
    scale = min(2 * WIDTH / width, 2 * HEIGHT / height)
    small = cv2.resize(rgb, (max(1, round(scale * width)), max(1, round(scale * height))), interpolation=cv2.INTER_AREA)
    file = thumbnail_file(path)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_png(file, small)
    except (OSError, DegenseError) as error:
        log.info("no picture of %s is kept: %s", path, error)


def thumbnail(path: Path) -> QPixmap:
    """The picture of a clip or run; an empty one where there is none."""
    reader = QImageReader(str(thumbnail_file(path)))
    size = reader.size()
    if not size.isValid() or max(size.width(), size.height()) > 2 * max(WIDTH, HEIGHT):
        return QPixmap()
    return QPixmap.fromImage(reader.read()).scaled(
        QSize(WIDTH, HEIGHT), Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
    )
