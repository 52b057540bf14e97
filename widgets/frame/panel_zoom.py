"""Where a frame lies in its panel: zoom and pan, without any painting."""

from __future__ import annotations

from PySide6.QtCore import QObject, QPointF, QRectF, QSizeF, Signal
from PySide6.QtWidgets import QWidget

#: Screen pixels that an image pixel takes at least and at most.
MIN_ZOOM, MAX_ZOOM = 0.05, 64.0

#: Widget pixels of the frame that stay in sight however far it is moved.
MARGIN = 40.0


class PanelZoom(QObject):
    """The map between image pixels and widget pixels."""

    changed = Signal(float)  # (factor) the user or the panel zoomed or moved the frame

    def __init__(self, panel: QWidget) -> None:
        super().__init__(panel)
        self._panel = panel
        self._size = QSizeF(1, 1)  # of the panel
        self.image = (1, 1)  # width and height of the frame
        self.scale = 1.0  # widget pixels an image pixel
        self.origin = QPointF()  # where the frame's corner lies in the widget
        self.fitted = True  # whether the whole frame is to be seen, whatever the size of the panel

    def factor(self) -> float:
        """Screen pixels an image pixel."""
        return self.scale * self._panel.devicePixelRatioF()

    def set_factor(self, factor: float, about: QPointF | None = None) -> None:
        """Zoom to `factor` screen pixels an image pixel; what lies under `about` (widget position, default: centre) stays there."""
        about = about if about is not None else QRectF(self._panel.rect()).center()
        fixed = self.to_image(about)
        self.scale, self.fitted = min(max(factor, MIN_ZOOM), MAX_ZOOM) / self._panel.devicePixelRatioF(), False
        self.origin = about - fixed * self.scale
        self._keep_in_sight()
        self._tell()

    def fit(self) -> None:
        """Show the whole frame in the middle, as large as it can be, and keep doing so when the panel is resized."""
        self.set_view(1.0, 0.0, 0.0, fitted=True)
        self._tell()

    def set_image(self, width: int, height: int) -> None:
        """The size of the frame; one of another size is fitted."""
        self.fitted |= (width, height) != self.image
        self.image = width, height
        if self.fitted:
            self.fit()

    def move(self, step: QPointF) -> None:
        """Shift the frame by widget pixels."""
        self.fitted = False
        self.origin += step
        self._keep_in_sight()
        self._tell()

    def resize(self, panel: QSizeF) -> None:
        """The panel has another size: a frame that is not enlarged is fitted, otherwise the middle stays in the middle."""
        whole = self.fitted or self.scale <= self._whole()
        grown, self._size = panel - self._size, panel
        if whole:
            self.fit()
        else:
            self.move(QPointF(grown.width() / 2, grown.height() / 2))

    def view(self) -> tuple[float, float, float]:
        """Widget pixels an image pixel, and the image point (x, y) in the middle of the panel: for another panel that shows the same."""
        middle = self.to_image(self._middle())
        return self.scale, middle.x(), middle.y()

    def set_view(self, scale: float, x: float, y: float, fitted: bool = False) -> None:
        """Zoom and pan as another panel whose `view` this is, or fit as it does. Emits nothing: two panels can follow each other."""
        if fitted:
            scale, x, y = self._whole(), self.image[0] / 2, self.image[1] / 2
        self.scale, self.fitted = scale, fitted
        self.origin = self._middle() - QPointF(x, y) * scale
        self._panel.update()

    def to_image(self, position: QPointF) -> QPointF:
        return (position - self.origin) / self.scale

    def to_widget(self, point: QPointF) -> QPointF:
        return self.origin + point * self.scale

    def target(self) -> QRectF:
        """The frame's rectangle in the widget."""
        return QRectF(self.origin.x(), self.origin.y(), self.image[0] * self.scale, self.image[1] * self.scale)

    def _whole(self) -> float:
        """The scale at which the whole frame is as large as it can be."""
        return max(min(self._size.width() / self.image[0], self._size.height() / self.image[1]), 1e-3)

    def _middle(self) -> QPointF:
        return QPointF(self._size.width() / 2, self._size.height() / 2)

    def _tell(self) -> None:
        self.changed.emit(self.factor())
        self._panel.update()

    def _keep_in_sight(self) -> None:
        width, height = self.image[0] * self.scale, self.image[1] * self.scale
        x = min(max(self.origin.x(), MARGIN - width), self._size.width() - MARGIN)
        y = min(max(self.origin.y(), MARGIN - height), self._size.height() - MARGIN)
        self.origin = QPointF(x, y)
