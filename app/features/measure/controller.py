"""Measuring: distances, paths and areas that are clicked in the 2D view and followed through the clip."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from PySide6.QtCore import QObject
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QHeaderView, QWidget

from degense.app.features.measure.marks import MeasureTool, Place, ToolKeys, paint_measure, paint_value
from degense.app.features.measure.results import Measured, Quantity, follow_measures, quantities_csv
from degense.app.features.measure.state import CORNERS, Kind, Measure, Measures
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.engine.files import write_text
from degense.engine.layer_titles import with_unit
from degense.widgets import forms
from degense.widgets.curve_plot import CurvePlot
from degense.widgets.frame.panel_zoom import PanelZoom
from degense.widgets.keys import ARROWS, keep_keys
from degense.widgets.qt_images import rgb, to_array, to_qimage
from degense.widgets.splats.guides import Guide
from degense.widgets.theme import class_colour

#: Width from which lines and numbers on a picture can be read, pixels.
LEGIBLE = 640
#: A measure, where its corners are in a frame, float [K, 2], and its value in words.
Shown = tuple[Measure, np.ndarray, str]
HINT = "Choose Distance, Path or Area, then click in the 2D view. What is measured moves with the tissue and is listed here."


class Measuring(QObject):
    """Follows the measures of the session in the worker, lists them, and paints them in both views."""

    def __init__(self, viewer: Viewer, guides: GuideSwitches) -> None:
        super().__init__(viewer)
        self._guides = guides
        guides.offer("measures", "Measures", self.lines)
        self.viewer, self.shell, self.session = viewer, viewer.shell, viewer.session
        self.state = Measures(self.session.undo)
        self.found: dict[Measure, Measured] = {}  # also of measures that undo may bring back
        self.tools: dict[Kind, MeasureTool] = {kind: MeasureTool(kind, self) for kind in CORNERS}
        self._add_panel()
        for tool in self.tools.values():
            tool.drawn.connect(self._drawn)
        ToolKeys(self.shell, viewer.panel, list(self.tools.values()))
        viewer.panel.marks.painters.append(self._paint)
        self.session.register("measures", self.state)
        self.state.changed.connect(lambda record: self._changed())
        self.session.opened.connect(lambda: self.dock.setEnabled(self.session.has_scene()))
        self.session.frame_changed.connect(lambda frame: self._show())

    def _add_panel(self) -> None:
        panel = QWidget()
        panel.setAccessibleName("Measure")
        self.buttons = {kind: forms.button(kind.capitalize(), partial(self.toggle, kind), tool.hint) for kind, tool in self.tools.items()}
        for button in self.buttons.values():
            button.setCheckable(True)
        self.table = forms.table("What is measured", ["Measure", "Now", "Change", "From … to"])
        self.table.itemSelectionChanged.connect(self._show_curve)
        self.table.itemDoubleClicked.connect(lambda item: self._go(item.row()))
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.table.horizontalHeader().setSectionResizeMode(3, QHeaderView.ResizeMode.Stretch)
        keep_keys(self.table, ARROWS)
        self.plot = CurvePlot()
        self.plot.setAccessibleName("What is measured over time")
        self.plot.set_message("Choose a row to see it over time")
        self.plot.x_clicked.connect(lambda x: self.session.go_to(round(x)))
        self._hint = forms.label(HINT, secondary=True)
        self.remove_button = forms.button("Remove", self.remove, "Remove the chosen measure")
        export = forms.button("Export…", self.export, "Save all values in all frames as a table")
        forms.column(
            forms.row(*self.buttons.values(), 0, self.remove_button, export),
            self._hint,
            (forms.row((self.table, 1), (self.plot, 1)), 1),
            parent=panel,
        )
        self.dock = self.shell.add_dock("Measure", panel)

    # Choosing

    def has_tool(self, kind: Kind) -> bool:
        return self.viewer.panel.tool is self.tools[kind]

    def toggle(self, kind: Kind) -> None:
        """Let clicks in the 2D view measure this, or no longer."""
        for tool in self.tools.values():
            tool.corners = []
        self.viewer.panel.set_tool(None if self.has_tool(kind) else self.tools[kind])
        if self.has_tool(kind):
            self.shell.docks.bring(self.dock)
            self.viewer.panel.setFocus()
        self._refresh()

    def _drawn(self, kind: Kind, corners: list[tuple[float, float]]) -> None:
        self.viewer.panel.set_tool(None)
        if self.session.scene is not None and self.viewer.is_surgeons():
            frame = round(self.viewer.view.frame) if self.viewer.view is not None else self.session.frame
            self.state.add(kind, frame, tuple(corners))
        else:
            self.shell.say("Measuring works in the surgeon's view; go back to it first.")
        self._refresh()

    def chosen(self) -> Measure | None:
        """The measure of the chosen row."""
        rows = self.table.selectionModel().selectedRows()
        listed = self._rows()
        return listed[rows[0].row()][0] if rows and rows[0].row() < len(listed) else None

    def remove(self) -> None:
        if (measure := self.chosen()) is not None:
            self.state.remove(measure)

    def _go(self, row: int) -> None:
        self.session.pause()
        self.session.go_to(self._rows()[row][0].frame)

    # Following

    def _changed(self) -> None:
        """Follow what is not followed yet."""
        scene = self.session.scene
        if scene is None:
            self.found.clear()
        missing = [measure for measure in self.state.measures if measure not in self.found]
        self.shell.worker.cancel("measures")
        if scene is not None and missing:
            self.shell.submit("measures", lambda: follow_measures(scene, missing), self._followed)
        self._show()

    def _followed(self, found: dict[Measure, Measured]) -> None:
        self.found |= found
        self._guides.show("measures")
        self._show()
        if self.chosen() is None and self.table.rowCount():
            self.table.selectRow(self.table.rowCount() - 1)

    # What is shown

    def quantities(self) -> list[Quantity]:
        """What is measured and known, in the order of the table."""
        return [quantity for _, quantity in self._rows() if quantity is not None]

    def _rows(self) -> list[tuple[Measure, Quantity | None]]:
        rows: list[tuple[Measure, Quantity | None]] = []
        for measure in self.state.measures:
            found = self.found.get(measure)
            rows += [(measure, quantity) for quantity in found.quantities] if found is not None else [(measure, None)]
        return rows

    def _show(self) -> None:
        rows = self._rows()
        forms.fill(self.table, [_cells(measure, quantity, self.session.frame) for measure, quantity in rows])
        self._hint.setVisible(not rows)
        self.remove_button.setEnabled(bool(rows))
        self._show_curve()
        self._refresh()

    def _show_curve(self) -> None:
        rows = self.table.selectionModel().selectedRows()
        listed = self._rows()
        quantity = listed[rows[0].row()][1] if rows and rows[0].row() < len(listed) else None
        self.plot.clear()
        if quantity is not None:
            frames = np.arange(len(quantity.values))
            colour = _colour(listed[rows[0].row()][0])
            self.plot.set_labels("frame", quantity.unit)
            self.plot.set_series(with_unit(quantity.title, quantity.unit), frames, quantity.values, colour)
            self.plot.set_cursor(self.session.frame)

    def _refresh(self) -> None:
        for kind, button in self.buttons.items():
            button.setChecked(self.has_tool(kind))
        self._guides.refresh()
        self.viewer.panel.update()
        self.shell.refresh()

    def _paint(self, painter: QPainter, zoom: PanelZoom) -> None:
        view = self.viewer.view
        if self.session.scene is None or view is None or self.viewer.free_camera() is not None:
            return
        paint_shown(painter, zoom.to_widget, self.shown(round(view.frame)))

    def shown(self, frame: int) -> list[Shown]:
        """What is measured as it is painted in a frame."""
        shown: list[Shown] = []
        for measure in self.state.measures:
            found = self.found.get(measure)
            if found is not None:
                shown.append((measure, found.pixels[:, frame], _value(found.quantities[0], frame)))
            elif frame == measure.frame:
                shown.append((measure, np.array(measure.corners), "…"))
        return shown

    def lines(self) -> list[Guide]:
        """What is measured in the 3D view: lines and outlines at the frame that is shown, each with its value."""
        frame, guides = self.session.frame, []
        for measure in self.state.measures:
            found = self.found.get(measure)
            corners = found.positions[:, frame] if found is not None else np.zeros((0, 3))
            corners = corners[np.isfinite(corners).all(1)]
            if found is not None and len(corners) > 1:
                way = np.concatenate([corners, corners[:1]]) if measure.kind == "area" else corners
                guides.append(Guide(way, rgb(_colour(measure)), f"{measure.title}: {_value(found.quantities[0], frame)}"))
        return guides

    # Files

    def can_export(self) -> bool:
        return bool(self.quantities())

    def export(self) -> None:
        """Save all values in all frames as a table."""
        scene = self.session.scene
        if scene is None or not self.can_export():
            self.shell.say("Nothing has been measured yet.")
            return
        path = self.shell.ask_save("Export measures", f"{self.session.name}-measures.csv", "Table (*.csv)")
        if path is not None:
            self.shell.attempt(lambda: write_text(path, quantities_csv(self.quantities(), scene.fps)))


def paint_shown(painter: QPainter, place: Place, shown: Sequence[Shown]) -> None:
    """Measures, and over all of them their values."""
    for measure, corners, _ in shown:
        paint_measure(painter, place, corners, _colour(measure), measure.kind == "area")
    for measure, corners, text in shown:
        paint_value(painter, place, corners, text, measure.kind == "area")


def with_measures(picture: np.ndarray, shown: Sequence[Shown]) -> np.ndarray:
    """A frame uint8 [H, W, 3] with measures painted on it, enlarged so that they are legible; without any the frame itself."""
    if not shown:
        return picture
    height, width = picture.shape[:2]
    scale = max(1, round(LEGIBLE / width))
    image = to_qimage(picture).scaled(scale * width, scale * height)
    with QPainter(image) as painter:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        paint_shown(painter, lambda point: point * scale, shown)
    return to_array(image)


def _colour(measure: Measure) -> QColor:
    return class_colour(measure.number - 1)


def _value(quantity: Quantity, frame: int) -> str:
    value = quantity.values[frame]
    return f"{value:.3g} {quantity.unit}" if np.isfinite(value) else "not known"


def _cells(measure: Measure, quantity: Quantity | None, frame: int) -> tuple[str, str, str, str]:
    if quantity is None:
        return measure.title, "…", "", ""
    if not np.isfinite(quantity.values).any():
        return quantity.title, "nothing is reconstructed there", "", ""
    low, high = np.nanmin(quantity.values), np.nanmax(quantity.values)
    change = quantity.change[frame]
    return (
        quantity.title,
        _value(quantity, frame),
        f"{change:+.3g}" if np.isfinite(change) else "",
        f"{low:.3g} … {high:.3g}",
    )
