"""Task: how far, how long, how large, and how that changes."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QFileDialog

from degense.engine.scene.tracks import follow_points
from degense.widgets import forms
from degense.widgets.qt_images import to_array
from tests.app import installed as on

LEFT = Qt.MouseButton.LeftButton


def at(window, x: float, y: float) -> QPoint:
    return on.viewer(window).panel.zoom.to_widget(QPointF(x, y)).toPoint()


@pytest.fixture
def measured(opened, idle):
    """A distance, a path and an area, clicked in frame 4."""
    window, panel = opened, on.viewer(opened).panel
    window.session.go_to(4)
    idle()
    panel.setFocus()
    QTest.keyClick(panel, Qt.Key.Key_D, Qt.KeyboardModifier.ShiftModifier)
    for corner in ((30, 30), (60, 45)):
        QTest.mouseClick(panel, LEFT, pos=at(window, *corner))
    idle()
    QTest.mouseClick(on.measuring(window).buttons["path"], LEFT)
    for corner in ((20, 20), (40, 22), (50, 40), (90, 75)):
        QTest.mouseClick(panel, LEFT, pos=at(window, *corner))
    QTest.keyClick(panel, Qt.Key.Key_Backspace)
    QTest.keyClick(panel, Qt.Key.Key_Return)
    idle()
    QTest.keyClick(panel, Qt.Key.Key_A, Qt.KeyboardModifier.ShiftModifier)
    for corner in ((40, 20), (65, 20), (65, 45), (40, 45), (40, 45)):  # the last one twice closes
        QTest.mouseClick(panel, LEFT, pos=at(window, *corner))
    idle()
    return window


def test_measures_move_with_the_tissue_and_are_listed(measured, idle, screenshot):
    window, measuring = measured, on.measuring(measured)
    assert [measure.title for measure in measuring.state.measures] == ["Distance 1", "Path 2", "Area 3"]
    assert [len(measure.corners) for measure in measuring.state.measures] == [2, 3, 4]
    scene, unit = window.session.scene, window.session.scene.unit
    assert window.session.probe is None  # the last click was the tool's
    distance, path, area, volume = measuring.quantities()
    corners = measuring.state.measures[0].corners
    ends = follow_points(scene, np.array([(4, *corner) for corner in corners])).positions
    np.testing.assert_allclose(distance.values, np.linalg.norm(ends[1] - ends[0], axis=-1))
    steps = follow_points(scene, np.array([(4, *corner) for corner in measuring.state.measures[1].corners])).positions
    np.testing.assert_allclose(path.values, np.linalg.norm(np.diff(steps, axis=0), axis=-1).sum(0))
    assert (distance.unit, area.unit, volume.unit) == (unit, f"{unit}²", f"{unit}³")
    assert area.values[4] > 0
    assert volume.values[4] == 0
    rows = forms.texts(measuring.table)
    assert [row[0] for row in rows] == ["Distance 1", "Path 2", "Area 3", "Volume change 3"]
    assert rows[0][1] == f"{distance.values[4]:.3g} {unit}"
    screenshot(window, "measure")
    QTest.keyClick(on.viewer(window).panel, Qt.Key.Key_End)
    idle()
    rows = forms.texts(measuring.table)
    assert rows[0][1] == f"{distance.values[9]:.3g} {unit}"
    assert rows[0][2] == f"{distance.values[9] - distance.values[4]:+.3g}"


def test_measures_are_drawn_in_both_views(measured, idle, screenshot):
    """The line of a distance lies on the tissue in 2D and in 3D, in its colour; a switch takes it from 3D."""
    window, measuring, splats = measured, on.measuring(measured), on.viewer(measured).splats
    scene, distance = window.session.scene, measuring.state.measures[0]
    ends = follow_points(scene, np.array([(4, *corner) for corner in distance.corners]))
    lines = measuring.lines()
    assert lines[0].text.startswith("Distance 1: ")
    assert [len(line.points) for line in lines] == [2, 3, 5]  # an area is closed
    np.testing.assert_allclose(lines[0].points, ends.positions[:, 4])
    colour = np.array(lines[0].colour)

    def drawn(picture: np.ndarray) -> int:
        return int((np.abs(picture.astype(int) - colour).max(-1) < 30).sum())

    panel, canvas = on.viewer(window).panel, splats.focusProxy()
    place = at(window, *(0.8 * ends.pixels[0, 4] + 0.2 * ends.pixels[1, 4]))  # where nothing else lies over the line
    around = to_array(panel.grab().toImage())[place.y() - 4 : place.y() + 5, place.x() - 4 : place.x() + 5]
    assert drawn(around) > 0
    with_lines = drawn(to_array(canvas.pixmap().toImage()))
    screenshot(window, "measure-3d")
    window.registry.run("guides.measures")
    idle()
    assert drawn(to_array(canvas.pixmap().toImage())) < with_lines - 10


def test_without_metric_depth_it_says_scene_units(opened, run, idle, screenshot):
    """A run of a clip whose depth has no unit: the table, the view and the axis of the curve say what the numbers are in."""
    window, measuring = opened, on.measuring(opened)
    on.documents(window).close()
    info = json.loads((run / "run.json").read_text(encoding="utf-8"))
    (run / "run.json").write_text(json.dumps(info | {"unit_name": "scene units"}), encoding="utf-8")
    on.documents(window).open_path(run)
    idle()
    panel = on.viewer(window).panel
    panel.setFocus()
    QTest.keyClick(panel, Qt.Key.Key_D, Qt.KeyboardModifier.ShiftModifier)
    for corner in ((30, 30), (60, 45)):
        QTest.mouseClick(panel, LEFT, pos=at(window, *corner))
    idle()
    [row] = forms.texts(measuring.table)
    assert row[1].endswith(" scene units")
    assert [text for _, _, text in measuring.shown(0)] == [row[1]]
    assert measuring.lines()[0].text == f"Distance 1: {row[1]}"
    assert measuring.plot._view._axes[0].labelText == "scene units"
    screenshot(window, "measure-scene-units")


def test_an_area_is_that_of_the_surface_in_the_depth(measured):
    """Against the depth of the frame: the sum over the pixels of what each covers of the surface."""
    window = measured
    scene = window.session.scene
    [_, _, area, _] = on.measuring(window).quantities()
    depth, camera = scene.render(4, what=("depth",))["depth"], scene.camera(4)
    columns, rows = np.meshgrid(np.arange(41, 65), np.arange(21, 45))
    corner = [camera.unproject(np.stack([columns + x, rows + y], -1).astype(float), depth[rows + y, columns + x]) for x, y in OFFSETS]
    triangles = (np.cross(corner[1] - corner[0], corner[2] - corner[0]), np.cross(corner[3] - corner[0], corner[2] - corner[0]))
    exact = sum(np.linalg.norm(each, axis=-1).sum() / 2 for each in triangles) * (25 * 25) / (24 * 24)
    assert area.values[4] == pytest.approx(exact, rel=0.25)  # the surface of the depth is rough from pixel to pixel


OFFSETS = ((0, 0), (1, 0), (1, 1), (0, 1))


def test_what_a_tool_wants_is_said_at_once(opened, idle):
    """Also while the pointer is not in the view yet, and in place of what was said before."""
    opened.docks.bring(on.measuring(opened).dock)
    opened.say("Displacement here: 2 mm.")
    QTest.mouseClick(on.measuring(opened).buttons["distance"], LEFT)
    assert opened.statusBar().currentMessage() == ""
    assert opened.status.hint.isVisible()
    assert "both ends" in opened.status.hint.text()


def test_measures_are_undone_saved_and_exported(measured, run, idle, tmp_path, monkeypatch):
    window, measuring = measured, on.measuring(measured)
    before = [quantity.values for quantity in measuring.quantities()]
    measuring.table.selectRow(1)
    assert list(measuring.plot.series) == [f"Path 2 [{window.session.scene.unit}]"]
    QTest.mouseClick(measuring.remove_button, LEFT)
    assert [measure.kind for measure in measuring.state.measures] == ["distance", "area"]
    window.registry.run("edit.undo")
    measuring.table.selectRow(1)
    window.registry.run("measure.remove")
    assert [measure.kind for measure in measuring.state.measures] == ["distance", "area"]
    window.registry.run("edit.undo")
    assert window.session.undo.redo_name == "Remove path 2"
    window.registry.run("file.save")
    on.documents(window).open_path(run)
    idle()
    for values, quantity in zip(before, measuring.quantities(), strict=True):
        np.testing.assert_allclose(values, quantity.values)
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *about: (str(tmp_path / "a.csv"), ""))
    window.registry.run("measure.export")
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    assert [int(row["frame"]) for row in rows] == list(range(10))
    assert float(rows[7][f"Distance 1 [{window.session.scene.unit}]"]) == pytest.approx(before[0][7], rel=1e-4)


def test_where_nothing_is_reconstructed_nothing_is_known(opened, idle):
    on.measuring(opened).state.add("distance", 2, ((-50.0, -50.0), (-60.0, -60.0)))
    on.measuring(opened).state.add("area", 2, ((-50.0, -50.0), (-60.0, -60.0), (-50.0, -60.0)))
    idle()
    rows = forms.texts(on.measuring(opened).table)
    assert [row[1] for row in rows] == ["nothing is reconstructed there"] * 3
