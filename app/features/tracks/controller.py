"""Points that are followed through the clip: their marks, trails, list and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject
from PySide6.QtGui import QColor, QIcon, QPainter, QPixmap
from PySide6.QtWidgets import QHeaderView, QWidget

from degense.app.features.tracks.marks import Mark, PointTool, paint_known, paint_mark
from degense.app.features.tracks.state import Point, TrackedPoints
from degense.app.features.tracks.tracks import TrackComparison, compare, follow, reach, tracks_csv, tracks_json, without_recording
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.engine.files import write_text
from degense.widgets import forms
from degense.widgets.frame.panel_zoom import PanelZoom
from degense.widgets.keys import ARROWS, keep_keys
from degense.widgets.splats.guides import Guide
from degense.widgets.theme import class_colour

if TYPE_CHECKING:
    from degense.engine.scene.tracks import Tracks

TRAIL = 20  # frames of a trail in the 2D view
HINT = "Choose Inspect ▸ Track points, then click tissue or an instrument in the 2D view. Drag a mark to correct it in its frame."


class PointTracking(QObject):
    """Follows the points of the session in the worker, and shows where they are."""

    def __init__(self, viewer: Viewer, guides: GuideSwitches) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session, self._guides = viewer, viewer.shell, viewer.session, guides
        self.state = TrackedPoints(self.session.undo)
        self.ways: dict[Point, Tracks] = {}  # without the axis of points; also of points that undo may bring back
        self.comparison: TrackComparison | None = None
        self._add_panel()
        self._tool = PointTool(viewer.panel.zoom, self.marks, self)
        self._tool.placed.connect(self._put)
        self._tool.chosen.connect(lambda number: self.table.selectRow([point.number for point in self.state.points].index(number)))
        viewer.panel.marks.painters.append(self._paint)
        guides.offer("tracks", "Tracks of points", self.trails)
        self.session.register("tracks", self.state)
        self.state.changed.connect(lambda record: self._changed())
        self.session.opened.connect(self._opened)

    def _add_panel(self) -> None:
        panel = QWidget()
        panel.setAccessibleName("Tracks")
        self.table = forms.table("Points that are followed", ["Point", "Set in frame", "Goes up to", "Visible"])
        self.table.itemClicked.connect(lambda item: self._go(item.row()))
        self.table.itemSelectionChanged.connect(self._refresh)
        for column in (0, 1, 3):
            self.table.horizontalHeader().setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        keep_keys(self.table, ARROWS)
        self._hint, self.scores = forms.label(HINT, secondary=True), forms.label(name="Scores")
        files = (
            forms.button("Compare…", self.compare, "Show the points of a track file, and how near to them ours come"),
            forms.button("Export…", self.export, "Save where the points are in all frames"),
        )
        forms.column((self.table, 1), forms.row((self._hint, 3), (self.scores, 1), *files), parent=panel)
        self.dock = self.shell.add_dock("Tracks", panel)

    def _opened(self) -> None:
        self.comparison = None
        self.scores.clear()
        self.dock.setEnabled(self.session.has_scene())

    # The points

    def is_adding(self) -> bool:
        return self.viewer.panel.tool is self._tool

    def toggle_adding(self) -> None:
        """Let clicks in the 2D view add points, or no longer."""
        self.viewer.panel.set_tool(None if self.is_adding() else self._tool)
        if self.is_adding():
            self.shell.docks.bring(self.dock)
        self.shell.refresh()

    def _frame(self) -> int:
        """The frame that the 2D view shows; the session may be ahead of it."""
        return round(self.viewer.view.frame) if self.viewer.view is not None else self.session.frame

    def _put(self, number: int | None, x: float, y: float) -> None:
        if self.session.scene is not None and self.viewer.is_surgeons():
            self.state.put(self._frame(), x, y, number)
            if number is None:
                self.table.selectRow(len(self.state.points) - 1)

    def chosen(self) -> Point | None:
        """The point of the chosen row."""
        rows, points = self.table.selectionModel().selectedRows(), self.state.points
        return points[rows[0].row()] if rows and rows[0].row() < len(points) else None

    def remove(self) -> None:
        if (point := self.chosen()) is not None:
            self.state.remove(point)

    def _go(self, row: int) -> None:
        self.session.pause()
        self.session.go_to(self.state.points[row].queries[0][0])

    # Following them

    def _changed(self) -> None:
        """Follow what is not followed yet."""
        scene = self.session.scene
        if scene is None:
            self.ways.clear()
        missing = [point for point in self.state.points if point not in self.ways]
        self.shell.worker.cancel("tracks")
        if scene is not None and missing:
            self.shell.submit("tracks", lambda: follow(scene, missing), self._followed)
        self._show()

    def _followed(self, ways: dict[Point, Tracks]) -> None:
        self.ways |= ways
        if self.session.scene is not None and (said := without_recording(self.session.scene)):
            self.shell.say(said)
        self._guides.show("tracks")
        self._show()

    def _show(self) -> None:
        """List the points, and bring both views up to date."""
        forms.fill(self.table, [self._cells(point) for point in self.state.points])
        for row, point in enumerate(self.state.points):
            pixmap = QPixmap(12, 12)
            pixmap.fill(_colour(point))
            forms.write(self.table, row, 0, str(point.number)).setIcon(QIcon(pixmap))
        self._hint.setVisible(not self.state.points)
        self._guides.refresh()
        self._refresh()

    def _cells(self, point: Point) -> tuple[str, ...]:
        frames, way = [query[0] for query in point.queries], self.ways.get(point)
        cells = (str(point.number), ", ".join(map(str, frames)))
        if way is None or self.session.scene is None:
            return (*cells, "…", "…")
        if not np.isfinite(way.pixels).all():
            return (*cells, "nothing is reconstructed there", "")
        far = f"{reach(way.pixels, frames[0]):.1f} px, {reach(way.positions, frames[0]):.2g} {self.session.scene.unit}"
        return (*cells, far, f"{way.visible.mean():.0%}")

    def _refresh(self) -> None:
        self.viewer.panel.update()
        self.shell.refresh()

    # What is shown

    def marks(self) -> list[Mark]:
        """The points in the frame that is shown; those that are not followed yet, or cannot be, where they were clicked."""
        frame, found = self._frame(), []
        for point in self.state.points:
            trail, visible = np.array([query[1:] for query in point.queries if query[0] == frame]), False
            if (way := self.ways.get(point)) is not None and np.isfinite(way.pixels[frame]).all():
                trail, visible = way.pixels[max(0, frame - TRAIL) : frame + 1], bool(way.visible[frame])
            if len(trail):
                found.append(Mark(point.number, _colour(point), trail[np.isfinite(trail).all(1)], visible))
        return found

    def _paint(self, painter: QPainter, zoom: PanelZoom) -> None:
        if self.session.scene is None or self.viewer.free_camera() is not None:
            return
        frame, chosen = self._frame(), self.chosen()
        if self.comparison is not None:
            known, found = self.comparison.known.pixels[:, frame], self.comparison.found.pixels[:, frame]
            there = np.isfinite(known).all(1)
            paint_known(painter, zoom, known[there], found[there])
        for mark in self.marks():
            paint_mark(painter, zoom, mark, chosen is not None and mark.number == chosen.number)

    def trails(self) -> list[Guide]:
        """The ways of the points up to this frame, in 3D."""
        lines = []
        for point in self.state.points:
            if (way := self.ways.get(point)) is not None:
                places, colour = way.positions[: max(2, self.session.frame + 1)], _colour(point)
                known = np.isfinite(places).all(1)
                lines.append(Guide(places[known], (colour.red(), colour.green(), colour.blue()), str(point.number)))
        return [line for line in lines if len(line.points) > 1]

    # Files

    def compare(self) -> None:
        """Show where a file says that points are, and how near to that following them comes."""
        scene, path = (
            self.session.scene,
            self.shell.ask_open("Compare with a track file", "", "Points (*.json *.csv *.npz icgstartseg.png info.yaml)"),
        )
        if path is None or scene is None:
            return

        def compared(comparison: TrackComparison) -> None:
            if self.session.scene is scene:
                self.comparison = comparison
                self.scores.setText(f"{path.name}: {comparison}")
                self.shell.docks.bring(self.dock)
                self._refresh()

        self.shell.run_task("export", f"Following the points of {path.name}", lambda: compare(scene, path), compared)

    def can_export(self) -> bool:
        return bool(self.state.points) and all(point in self.ways for point in self.state.points)

    def export(self) -> None:
        """Save the tracks in a file, as its suffix says."""
        from degense.engine.scene.tracks import Tracks

        points, scene = self.state.points, self.session.scene
        if scene is None or not self.can_export():
            self.shell.say("There are no tracks yet.")
            return
        path = self.shell.ask_save("Export tracks", f"{self.session.name}-tracks.csv", "Table (*.csv);;JSON (*.json)")
        if path is not None:
            ways = Tracks(*(np.stack(values) for values in zip(*(self.ways[point] for point in points), strict=True)))
            first, numbers = np.array([point.queries[0] for point in points]), [point.number for point in points]
            text = tracks_csv(numbers, ways) if path.suffix.lower() == ".csv" else tracks_json(scene.unit, first, ways, {})
            self.shell.attempt(lambda: write_text(path, text))


def _colour(point: Point) -> QColor:
    return class_colour(point.number - 1)
