"""From the hand to label maps: strokes, polygons, fills, superpixels, the masks of prompts, and the keys of the tools."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QApplication

from degense.app.features.annotate.state import AnnotationState
from degense.app.features.annotate.tool import TOOLS
from degense.app.shell.shell import Shell
from degense.engine.annotation.painting import PixelRegion, brush, fill, holes, polygon, region_of, smaller_islands, whole_regions
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError
from degense.widgets.frame.paint_tools import ClickTool, PolygonTool, StrokeTool
from degense.widgets.frame.panel_tools import PanelTool
from degense.widgets.frame.render_panel import RenderPanel
from degense.widgets.keys import consumes_key

DIGITS = range(Qt.Key.Key_1, Qt.Key.Key_9 + 1)
STEP = 2**0.25  # of the radius


class Painter(QObject):
    """Paints the frame that is shown with what the tools of the panel report."""

    def __init__(self, shell: Shell, state: AnnotationState, panel: RenderPanel) -> None:
        super().__init__(shell)
        self.shell, self.session, self.state, self.panel = shell, shell.session, state, panel
        self.strokes, self.polygons, self.clicks = StrokeTool(self), PolygonTool(self), ClickTool(self)
        self._regions: tuple[int, np.ndarray] | None = None
        self.session.opened.connect(self._forget_regions)
        self.strokes.began.connect(self._stroke_began)
        self.strokes.moved.connect(lambda ax, ay, bx, by: self._dab((ax, ay), (bx, by)))
        self.strokes.ended.connect(state.end)
        self.polygons.drawn.connect(lambda corners: self._paint("Polygon", lambda: polygon(corners, self._shape())))
        self.clicks.clicked.connect(self._clicked)

    def show_tool(self) -> None:
        """Let the panel have the tool that is chosen while one annotates."""
        tool = self.state.tool
        self.strokes.radius = tool.radius
        tools: dict[str, PanelTool] = {"polygon": self.polygons, "fill": self.clicks, "wand": self.clicks}
        chosen = tools.get(tool.name, self.strokes)
        chosen.hint = next(kind.description for kind in TOOLS if kind.name == tool.name)
        if not tool.active or tool.name != "polygon":
            self.polygons.cancel()
        if tool.active and self.panel.tool is not chosen:
            self.panel.set_tool(chosen)
        elif not tool.active and self.panel.tool in (self.strokes, self.polygons, self.clicks):
            self.panel.set_tool(None)
        self.panel.show_hint()
        self.panel.update()

    def end(self) -> None:
        """End the stroke and drop an unfinished polygon: another frame is shown."""
        self.state.end()
        self.polygons.cancel()

    def fill_holes(self) -> None:
        self._paint("Fill holes", lambda: holes(self._labels(), self.state.tool.label), self.state.tool.label)

    def keep_largest(self) -> None:
        self._paint("Largest part", lambda: smaller_islands(self._labels(), self.state.tool.label), UNLABELLED)

    def _clicked(self, x: float, y: float) -> None:
        at = int(np.floor(x)), int(np.floor(y))
        if self.state.tool.name == "fill":
            self._paint("Fill", lambda: fill(self._labels(), at))
            return
        if self.session.scene is None or not self.session.view_state.visible_prompts:
            self.shell.say("Prompt something first: the wand takes the mask under the click.")
            return

        def done(texts: Sequence[str], found: np.ndarray) -> None:
            inside = 0 <= at[1] < found.shape[0] and 0 <= at[0] < found.shape[1] and found[at[1], at[0]] != UNLABELLED
            if inside:
                self._paint(f"Mask of {texts[found[at[1], at[0]]]}", lambda: fill(found, at))
            else:
                self.shell.say("No mask of a prompt lies there.")

        self._decode(done)

    def _decode(self, done: Callable[[Sequence[str], np.ndarray], None]) -> None:
        """Hand over the visible prompts and which of them owns each pixel of the frame, uint8 [H, W], if it is still shown then."""
        scene, frame, prompts = self.session.scene, self.session.frame, self.session.view_state.prompt_set
        assert scene is not None

        def labels() -> np.ndarray:
            from degense.engine.scene.clip_query import decode_frame

            return decode_frame(scene, prompts, frame).labels

        def decoded(found: np.ndarray) -> None:
            if frame == self.session.frame and scene is self.session.scene:
                done(prompts.prompts, found)

        self.shell.submit("annotate", labels, decoded, self.shell.say)

    def paint_prompts(self) -> None:
        """Paint the masks of the visible prompts, each in the class of its name, which is made where there is none."""

        def done(texts: Sequence[str], found: np.ndarray) -> None:
            for index, text in enumerate(texts):
                names = [kind.title.casefold() for kind in self.state.work.classes] if self.state.work else []
                if text.casefold() not in names:
                    self.state.add_class(text)
                    names.append(text.casefold())
                self._paint(f"Mask of {text}", partial(region_of, found == index), names.index(text.casefold()))

        self._decode(done)

    def superpixels(self) -> np.ndarray:
        """Superpixels of the frame, int32 [H, W]; found once a frame."""
        frame = self.session.frame
        if self._regions is None or self._regions[0] != frame:
            from degense.engine.semantics.masks import superpixels

            clip, scene = self.session.clip, self.session.scene
            if clip is not None:
                pixels = clip.frame(frame)
            else:
                assert scene is not None
                pixels = scene.render_rgb(frame)
            self._regions = frame, superpixels(pixels)
        return self._regions[1]

    def _forget_regions(self) -> None:
        self._regions = None

    def _shape(self) -> tuple[int, int]:
        return self.session.size[1], self.session.size[0]

    def _labels(self) -> np.ndarray:
        return self.state.labels(self.session.frame)

    def _check_at_hand(self) -> None:
        """DegenseError while the worker reads the labels of the frame."""
        if not self.state.is_at_hand(self.session.frame):
            raise DegenseError(f"The labels of frame {self.session.frame} are being read; paint when they are shown.")

    def _stroke_began(self, x: float, y: float) -> None:
        try:
            self._check_at_hand()
            self.state.begin({"eraser": "Erase", "superpixels": "Paint regions"}.get(self.state.tool.name, "Paint"))
        except DegenseError as error:
            self.shell.say(str(error))
            return
        self._dab((x, y), (x, y))

    def _dab(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        region = brush(start, end, self.state.tool.radius, self._shape())
        self.state.dab(whole_regions(self.superpixels(), region) if self.state.tool.name == "superpixels" else region)

    def _paint(self, name: str, region: Callable[[], PixelRegion | None], value: int | None = None) -> None:
        try:
            self._check_at_hand()
            if not self.state.paint(name, region(), value):
                self.shell.say(f"{name}: nothing changed.")
        except DegenseError as error:
            self.shell.say(str(error))


class AnnotationKeys(QObject):
    """Keys that mean something else while one annotates: 1–9 choose classes, [ and ] the size, N or Tab and P call `go_on` with 1 and −1.

    They are taken before the window's shortcuts are, unless something that types has the focus.
    """

    def __init__(self, shell: Shell, state: AnnotationState, painter: Painter, go_on: Callable[[int], object]) -> None:
        super().__init__(shell)
        self.state, self.panel = state, painter.panel
        self._polygon_keys: dict[int, Callable[[], object]] = {
            Qt.Key.Key_Return: painter.polygons.close,
            Qt.Key.Key_Enter: painter.polygons.close,
            Qt.Key.Key_Backspace: painter.polygons.remove_last,
            Qt.Key.Key_Escape: painter.polygons.cancel,
        }
        self._keys: dict[int, Callable[[], object]] = {
            Qt.Key.Key_Tab: partial(go_on, 1),
            Qt.Key.Key_N: partial(go_on, 1),
            Qt.Key.Key_P: partial(go_on, -1),
            Qt.Key.Key_BracketLeft: lambda: state.tool.choose(radius=state.tool.radius / STEP),
            Qt.Key.Key_BracketRight: lambda: state.tool.choose(radius=state.tool.radius * STEP),
            **{key: partial(state.choose_class, key - Qt.Key.Key_1) for key in DIGITS},
        }
        self._polygons = painter.polygons
        for watched in (shell, self.panel):
            watched.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() not in (QEvent.Type.ShortcutOverride, QEvent.Type.KeyPress) or not isinstance(event, QKeyEvent):
            return False
        if not self.state.tool.active or event.modifiers() not in (Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.KeypadModifier):
            return False
        focus, key = QApplication.focusWidget(), event.key()
        act = self._polygon_keys.get(key) if self._polygons.corners > 0 else None
        act = act or self._keys.get(key)
        if act is None or consumes_key(focus) or (key == Qt.Key.Key_Tab and focus is not self.panel):
            return False
        if event.type() == QEvent.Type.KeyPress:
            act()
            self.panel.update()
        event.accept()
        return True
