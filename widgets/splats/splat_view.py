"""The 3D view: sorted anisotropic splats on the screen, the surgeon's camera, free look and picking."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QColor, QKeyEvent, QMouseEvent, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QLabel, QVBoxLayout, QWidget

from degense.engine.camera import Camera
from degense.engine.colour_maps import colourise
from degense.widgets.keys import ARROWS, keep_keys
from degense.widgets.splats.camera_moves import dolly, framing, letterboxed, orbit, pan, splat_at
from degense.widgets.splats.gaussians import Gaussians, as_bytes, tamed
from degense.widgets.splats.rendered_surface import StillDrawer, StillRequest, StillSurface
from degense.widgets.theme import frame_background

#: The hand rests when it has not moved the camera for so long, milliseconds.
IDLE_MS = 120

#: A press and release closer than this is a click, pixels.
CLICK_SLACK = 4

#: Colour of marked splats, its share beside their own, which shines through, and their least opacity.
HIGHLIGHT = np.array([255, 64, 255], np.float32)
MARKED = 0.6


class Surface(Protocol):
    """What draws the splats: `VtkSurface` or `StillSurface`."""

    @property
    def widget(self) -> QWidget: ...
    def set_splats(self, gaussians: Gaussians, colours: np.ndarray) -> None: ...
    def set_colours(self, colours: np.ndarray, opacities: np.ndarray) -> None: ...
    def set_background(self, colour: QColor) -> None: ...
    def view_state(self, camera: Camera, lowpass_scale: float, moving: bool) -> None: ...
    def picture(self) -> np.ndarray: ...


class SplatView(QWidget):
    """Splats seen by a `Camera`.

    Locked, it shows the surgeon's view exactly as the 2D panel does when fitted; a drag leaves that view and looks around freely.

    Parameters
    ----------
    draw : StillDrawer, optional
        For machines without a GPU: the owner draws the pictures, elsewhere. `still_wanted` asks, `still_request` says what is to be drawn,
        and `set_still` shows it; `draw` makes one at once, for screenshots. Without it VTK draws.
    """

    camera_moved = Signal(object)
    locked_changed = Signal(bool)
    picked = Signal(int)
    still_wanted = Signal()

    def __init__(self, parent: QWidget | None = None, draw: StillDrawer | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("3D view")
        self.setMinimumSize(160, 120)
        self._stills: StillSurface | None = None
        if draw is None:
            from degense.widgets.splats.vtk_surface import VtkSurface  # takes a second to load

            self._surface: Surface = VtkSurface(self)
        else:
            self._surface = self._stills = StillSurface(self, draw)
            self._stills.wanted.connect(self.still_wanted)
        self._canvas = self._surface.widget
        self._canvas.setAccessibleName("Splats")
        self._canvas.setAcceptDrops(False)
        self._canvas.installEventFilter(self)
        keep_keys(self._canvas, ARROWS | {Qt.Key.Key_R, Qt.Key.Key_Plus, Qt.Key.Key_Minus, Qt.Key.Key_Equal})
        self.setFocusProxy(self._canvas)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._canvas)
        self._note = QLabel(self)
        self._note.setObjectName("viewNote")
        self._note.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._note.move(8, 8)

        self._gaussians: Gaussians | None = None
        self._colours = np.zeros((0, 3), np.uint8)
        self._scalars: tuple[np.ndarray, str, float, float] | None = None
        self._highlight: np.ndarray | None = None
        self._home: Camera | None = None
        self._free: Camera | None = None
        self._background: QColor | None = None
        self._press: QPointF | None = None
        self._last = QPointF()
        self._dragging = False
        self._closed = False
        self._idle = QTimer(self)
        self._idle.setSingleShot(True)
        self._idle.setInterval(IDLE_MS)
        self._idle.timeout.connect(self._settle)
        self._paint_background()
        self._apply_camera()

    # What is shown

    def set_splats(self, means: np.ndarray, quats: np.ndarray, scales: np.ndarray, opacities: np.ndarray, colours: np.ndarray) -> None:
        """Show other splats (arrays as in `tamed`; colours [N, 3], uint8 or float in [0, 1]).

        The camera stays; scalars and highlight stay as long as the number of splats does.
        """
        if self._closed:
            return
        if self._gaussians is None or len(means) != len(self._gaussians.means):
            self._scalars = self._highlight = None
        self._gaussians = tamed(means, quats, scales, opacities)
        self._colours = as_bytes(colours)
        self._surface.set_splats(self._gaussians._replace(opacities=self._shown_opacities(self._gaussians)), self._shown_colours())
        self._apply_camera()

    def set_scalars(self, values: np.ndarray, cmap: str, low: float, high: float) -> None:
        """Colour the splats by one value each, [N], through a colour map; NaN is grey."""
        if len(values) != len(self._colours):
            raise ValueError(f"{len(values)} scalars for {len(self._colours)} splats")
        self._scalars = (np.asarray(values), cmap, low, high)
        self._recolour()

    def clear_scalars(self) -> None:
        self._scalars = None
        self._recolour()

    def highlight(self, indices: np.ndarray | None) -> None:
        """Mark some splats in magenta and make them opaque enough to be seen; None or an empty array clears."""
        marked = None if indices is None or len(indices) == 0 else np.asarray(indices, np.int64)
        if marked is not None or self._highlight is not None:
            self._highlight = marked
            self._recolour()

    def set_background(self, colour: QColor | None) -> None:
        """A colour of one's own, or None for the theme's."""
        self._background = colour
        self._paint_background()

    # Pictures drawn elsewhere

    def still_request(self) -> StillRequest | None:
        """What is to be drawn now; None when there is nothing, or VTK draws."""
        return self._stills.request() if self._stills is not None and not self._closed else None

    def set_still(self, rgb: np.ndarray) -> None:
        """Show a picture of what `still_request` told, uint8 [H, W, 3]."""
        if self._stills is not None and not self._closed:
            self._stills.take(rgb)

    # The camera

    def set_camera(self, camera: Camera) -> None:
        """Lock to a camera of the clip."""
        self._home, self._free = camera, None
        self._apply_camera()

    def set_free_camera(self, camera: Camera) -> None:
        """Look around freely from this camera on."""
        self._free = camera
        self._apply_camera()

    def fly_to(self, camera: Camera) -> None:
        """Look from there as if a hand had moved the camera: roughly drawn now, and well when it rests. Of the lock nobody is told."""
        self._free = camera
        self._idle.start()
        self._apply_camera()
        self.camera_moved.emit(camera)

    def is_locked(self) -> bool:
        return self._free is None and self._home is not None

    def camera(self) -> Camera:
        """The camera in use: the clip's own when locked, else one whose image is the whole view in device pixels."""
        return self._home if self._free is None and self._home is not None else self._viewport_camera()

    def reset_view(self) -> None:
        """Back to the surgeon's view, or to a camera that sees everything when there is none."""
        was_locked = self.is_locked()
        self._free = None
        self._apply_camera()
        if self.is_locked() and not was_locked:
            self.locked_changed.emit(True)
        self.camera_moved.emit(self.camera())

    def screenshot_image(self) -> np.ndarray:
        """What is on the screen, uint8 [H, W, 3] in device pixels."""
        self._settle()
        return self._surface.picture()

    def pick(self, x: float, y: float) -> int:
        """Index of the splat that one sees at a position in the widget (logical pixels), −1 for none."""
        if self._gaussians is None:
            return -1
        ratio = self._canvas.devicePixelRatioF()
        return splat_at(x * ratio, y * ratio, self._viewport_camera(), *self._gaussians)

    # Inside

    def _pixels(self) -> tuple[int, int]:
        ratio = self._canvas.devicePixelRatioF()
        return max(1, round(self._canvas.width() * ratio)), max(1, round(self._canvas.height() * ratio))

    def _viewport_camera(self) -> Camera:
        width, height = self._pixels()
        camera = self._free or self._home
        if camera is None:
            return framing(self._gaussians.means if self._gaussians is not None else np.zeros((0, 3)), width, height)
        return letterboxed(camera, width, height)

    def _apply_camera(self) -> None:
        if self._closed:
            return
        self._write_note()
        camera = self._viewport_camera()
        # Locked, the pixels of the clip are dilated, as in the 2D panel; free, those of the screen.
        lowpass = camera.fx / self._home.fx if self._home is not None and self._free is None else 1.0
        self._surface.view_state(camera, lowpass, moving=self._idle.isActive())

    def _write_note(self) -> None:
        self._note.setText("Surgeon’s view" if self.is_locked() else "Free look — R goes back" if self._home is not None else "Free look")
        self._note.adjustSize()
        self._note.setVisible(self._gaussians is not None)

    def _shown_colours(self) -> np.ndarray:
        colours = self._colours if self._scalars is None else colourise(*self._scalars)
        if self._highlight is not None:
            colours = colours.copy()
            colours[self._highlight] = (HIGHLIGHT * np.float32(MARKED) + colours[self._highlight] * np.float32(1 - MARKED)).astype(np.uint8)
        return colours

    def _shown_opacities(self, gaussians: Gaussians) -> np.ndarray:
        if self._highlight is None:
            return gaussians.opacities
        opacities = gaussians.opacities.copy()
        opacities[self._highlight] = np.maximum(opacities[self._highlight], MARKED)
        return opacities

    def _recolour(self) -> None:
        if self._gaussians is not None and not self._closed:
            self._surface.set_colours(self._shown_colours(), self._shown_opacities(self._gaussians))

    def _paint_background(self) -> None:
        self._surface.set_background(self._background or frame_background(self.palette()))

    def _pivot(self) -> np.ndarray:
        """The point one turns around: the middle of the scene in front of the camera."""
        if self._gaussians is None or not len(self._gaussians.means):
            return np.zeros(3)
        return np.median(self._gaussians.means, 0).astype(np.float64)

    def _move(self, camera: Camera) -> None:
        """The hand moved the camera."""
        was_locked = self.is_locked()
        self.fly_to(camera)
        if was_locked:
            self.locked_changed.emit(False)

    def _settle(self) -> None:
        if self._closed:
            return
        self._idle.stop()
        self._apply_camera()

    # Events: the canvas would hand them to VTK's own interaction styles, which know nothing of our cameras.

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        kind = event.type()
        if isinstance(event, QMouseEvent):
            if kind == QEvent.Type.MouseButtonPress:
                self._pressed(event)
            elif kind == QEvent.Type.MouseMove:
                self._dragged(event)
            elif kind == QEvent.Type.MouseButtonRelease:
                self._released(event)
            return True
        if isinstance(event, QWheelEvent):
            self._wheeled(event)
            return True
        if isinstance(event, QKeyEvent) and kind == QEvent.Type.KeyPress:
            self._key(event)
            return True
        return kind in (QEvent.Type.KeyRelease, QEvent.Type.Enter, QEvent.Type.Leave)

    def _pressed(self, event: QMouseEvent) -> None:
        self._canvas.setFocus(Qt.FocusReason.MouseFocusReason)
        self._press = self._last = event.position()
        self._dragging = False

    def _dragged(self, event: QMouseEvent) -> None:
        if self._press is None or not event.buttons():
            return
        if not self._dragging and (event.position() - self._press).manhattanLength() <= CLICK_SLACK:
            return
        self._dragging = True
        step = event.position() - self._last
        self._last = event.position()
        camera, pivot = self._viewport_camera(), self._pivot()
        shift = event.modifiers() & Qt.KeyboardModifier.ShiftModifier
        if event.buttons() & Qt.MouseButton.LeftButton and not shift:
            turn = np.pi / max(self.height(), 1)
            self._move(orbit(camera, pivot, step.x() * turn, step.y() * turn))
        elif event.buttons() & Qt.MouseButton.RightButton:
            self._move(dolly(camera, pivot, 1.01 ** step.y()))
        else:
            ratio = self._canvas.devicePixelRatioF()
            self._move(pan(camera, pivot, step.x() * ratio, step.y() * ratio))

    def _released(self, event: QMouseEvent) -> None:
        click = self._press is not None and not self._dragging and event.button() == Qt.MouseButton.LeftButton
        self._press, self._dragging = None, False
        if click:
            self.picked.emit(self.pick(event.position().x(), event.position().y()))

    def _wheeled(self, event: QWheelEvent) -> None:
        self._move(dolly(self._viewport_camera(), self._pivot(), 0.9 ** (event.angleDelta().y() / 120.0)))

    def _key(self, event: QKeyEvent) -> None:
        camera, pivot, turn = self._viewport_camera(), self._pivot(), np.radians(5.0)
        match event.key():
            case Qt.Key.Key_Left:
                self._move(orbit(camera, pivot, -turn, 0.0))
            case Qt.Key.Key_Right:
                self._move(orbit(camera, pivot, turn, 0.0))
            case Qt.Key.Key_Up:
                self._move(orbit(camera, pivot, 0.0, -turn))
            case Qt.Key.Key_Down:
                self._move(orbit(camera, pivot, 0.0, turn))
            case Qt.Key.Key_Plus | Qt.Key.Key_Equal:
                self._move(dolly(camera, pivot, 0.9))
            case Qt.Key.Key_Minus:
                self._move(dolly(camera, pivot, 1 / 0.9))
            case Qt.Key.Key_R:
                self.reset_view()
            case _:
                event.ignore()  # goes on to the parents

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        QTimer.singleShot(0, self, self._apply_camera)

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and not self._closed:
            self._paint_background()

    def closeEvent(self, event: QCloseEvent) -> None:
        """Give VTK's window back while its OpenGL context still lives."""
        if not self._closed:
            self._closed = True
            self._idle.stop()
            self._canvas.removeEventFilter(self)
            self._canvas.close()
        super().closeEvent(event)
