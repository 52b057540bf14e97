"""Where a picture lies in its panel: zoom and pan, without any painting."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF, QSizeF

MIN_ZOOM, MAX_ZOOM = 0.05, 64.0

#: Widget pixels of the picture that stay in sight however far it is moved.
MARGIN = 40.0


class PanelZoom:
    """The map between image pixels and widget pixels.

    Attributes
    ----------
    image : (int, int)
        Width and height of the full-size picture.
    panel : QSizeF
        Of the widget.
    scale : float
        Widget pixels an image pixel.
    origin : QPointF
        Where the picture's corner lies in the widget.
    fitted : bool
        Whether the whole picture is to be seen, whatever the size of the panel.
    """

    def __init__(self) -> None:
        self.image = (1, 1)
        self.panel = QSizeF(1, 1)
        self.scale = 1.0
        self.origin = QPointF()
        self.fitted = True

    def fit(self) -> None:
        """Show the whole picture in the middle, as large as it can be."""
        width, height = self.image
        self.fitted = True
        self.scale = max(min(self.panel.width() / width, self.panel.height() / height), 1e-3)
        self.origin = QPointF((self.panel.width() - width * self.scale) / 2, (self.panel.height() - height * self.scale) / 2)

    def zoom_to(self, scale: float, about: QPointF) -> None:
        """Another scale; what lies under `about` (widget position) stays there."""
        fixed = self.to_image(about)
        self.scale, self.fitted = scale, False
        self.origin = about - fixed * scale
        self._keep_in_sight()

    def move(self, step: QPointF) -> None:
        """Shift the picture by widget pixels."""
        self.fitted = False
        self.origin += step
        self._keep_in_sight()

    def resize(self, panel: QSizeF) -> None:
        """The panel has another size: the whole picture stays whole, otherwise the middle stays in the middle."""
        grown, self.panel = panel - self.panel, panel
        if self.fitted:
            self.fit()
        else:
            self.move(QPointF(grown.width() / 2, grown.height() / 2))

    def view(self) -> tuple[float, float, float]:
        """Scale, and the image point (x, y) in the middle of the panel."""
        middle = self.to_image(QPointF(self.panel.width() / 2, self.panel.height() / 2))
        return self.scale, middle.x(), middle.y()

    def set_view(self, scale: float, x: float, y: float) -> None:
        """Look as another panel whose `view` this is."""
        self.scale, self.fitted = scale, False
        self.origin = QPointF(self.panel.width() / 2, self.panel.height() / 2) - QPointF(x, y) * scale

    def to_image(self, position: QPointF) -> QPointF:
        return (position - self.origin) / self.scale

    def to_widget(self, point: QPointF) -> QPointF:
        return self.origin + point * self.scale

    def target(self) -> QRectF:
        """The picture's rectangle in the widget."""
        return QRectF(self.origin.x(), self.origin.y(), self.image[0] * self.scale, self.image[1] * self.scale)

    def _keep_in_sight(self) -> None:
        width, height = self.image[0] * self.scale, self.image[1] * self.scale
        x = min(max(self.origin.x(), MARGIN - width), self.panel.width() - MARGIN)
        y = min(max(self.origin.y(), MARGIN - height), self.panel.height() - MARGIN)
        self.origin = QPointF(x, y)
