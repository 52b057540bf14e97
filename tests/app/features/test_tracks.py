"""Task: follow points that are clicked, correct them by hand, compare them with a track file, and export them."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from PySide6.QtCore import QLineF, QPoint, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QImage, QPainter
from PySide6.QtWidgets import QFileDialog, QMessageBox

from degense.app.cli.main import main
from degense.app.features.tracks.marks import Mark, paint_mark
from degense.engine.scene.tracks import follow_points
from degense.widgets import forms
from degense.widgets.frame.render_panel import RenderPanel
from tests.app import installed as on

LEFT = Qt.MouseButton.LeftButton


def at(window, x: float, y: float) -> QPoint:
    return on.viewer(window).panel.zoom.to_widget(QPointF(x, y)).toPoint()


@pytest.fixture
def click(qtbot, idle):
    def click(window, x: float, y: float) -> None:
        qtbot.mouseClick(on.viewer(window).panel, LEFT, pos=at(window, x, y))
        idle()

    return click


@pytest.fixture
def drag(qtbot, idle):
    def drag(window, start: tuple[float, float], end: tuple[float, float]) -> None:
        panel = on.viewer(window).panel
        qtbot.mousePress(panel, LEFT, pos=at(window, *start))
        qtbot.mouseMove(panel, at(window, *end))
        qtbot.mouseRelease(panel, LEFT, pos=at(window, *end))
        idle()

    return drag


@pytest.fixture
def tracked(qtbot, opened, idle, click):
    """Two points: one clicked in frame 0, one in frame 6."""
    panel = on.viewer(opened).panel
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_T)
    click(opened, 40, 30)
    opened.session.go_to(6)
    idle()
    click(opened, 60, 45)
    return opened


def expected(window, *queries: tuple[int, float, float]):
    return follow_points(window.session.scene, np.array(queries))


def shown(window) -> dict[int, np.ndarray]:
    return {mark.number: mark.trail[-1] for mark in on.tracking(window).marks()}


def test_clicked_points_are_followed_and_listed(qtbot, tracked, idle, click, screenshot):
    tracking, session = on.tracking(tracked), tracked.session
    first, second = (point.queries[0] for point in tracking.state.points)
    assert (first[0], second[0]) == (0, 6)
    np.testing.assert_allclose([first[1:], second[1:]], [(40, 30), (60, 45)], atol=0.3)
    found = expected(tracked, first, second)
    for frame in (6, 9, 2):
        session.go_to(frame)
        idle()
        np.testing.assert_allclose(list(shown(tracked).values()), found.pixels[:, frame])
    np.testing.assert_allclose([line.points for line in tracking.trails()], found.positions[:, :3])
    rows = forms.texts(tracking.table)
    assert [row[:2] for row in rows] == [("1", "0"), ("2", "6")]
    way = np.linalg.norm(found.pixels[1] - found.pixels[1, 6], axis=1).max()
    assert rows[1][2].startswith(f"{way:.1f} px")
    assert rows[1][3] == f"{found.visible[1].mean():.0%}"
    screenshot(tracked, "tracks")
    qtbot.mouseClick(tracking.table.viewport(), LEFT, pos=tracking.table.visualItemRect(tracking.table.item(1, 1)).center())
    assert session.frame == 6
    idle()
    click(tracked, *found.pixels[0, 6])  # on a mark: chooses it
    assert tracking.chosen().number == 1
    assert len(tracking.state.points) == 2
    qtbot.keyClick(on.viewer(tracked).panel, Qt.Key.Key_T)
    click(tracked, 20, 20)  # the tool is put away: the probe has the click
    assert len(tracking.state.points) == 2


def test_a_point_is_corrected_by_dragging_it(tracked, idle, drag):
    tracking, session = on.tracking(tracked), tracked.session
    session.go_to(4)
    idle()
    x, y = shown(tracked)[1]
    drag(tracked, (x, y), (x + 9, y + 6))
    first, corrected = tracking.state.points[0].queries
    assert corrected[0] == 4
    np.testing.assert_allclose(corrected[1:], (x + 9, y + 6), atol=0.6)
    before, after = expected(tracked, first, corrected).pixels
    way = tracking.ways[tracking.state.points[0]].pixels
    np.testing.assert_allclose(way[:4], before[:4])
    np.testing.assert_allclose(way[4:], after[4:])
    assert np.linalg.norm(way - before, axis=1)[4:].min() > 1
    np.testing.assert_allclose(shown(tracked)[1], corrected[1:], atol=1e-6)
    session.undo.undo()
    idle()
    np.testing.assert_allclose(tracking.ways[tracking.state.points[0]].pixels, before)


def test_points_are_removed_undone_and_saved(qtbot, tracked, idle):
    tracking, session = on.tracking(tracked), tracked.session
    points = tracking.state.points
    qtbot.mouseClick(tracking.table.viewport(), LEFT, pos=tracking.table.visualItemRect(tracking.table.item(0, 1)).center())
    assert tracked.registry["tracks.remove"].enabled()
    qtbot.keyClick(tracking.table, Qt.Key.Key_Delete)
    assert tracking.state.points == points[1:]
    assert forms.texts(tracking.table)[0][0] == "2"
    session.undo.undo()
    tracked.registry.run("tracks.clear")
    assert tracking.table.rowCount() == 0
    assert shown(tracked) == {}
    session.undo.undo()
    session.save()
    folder = session.scene.run.path
    on.documents(tracked).open_path(folder)
    idle()
    assert tracking.state.points == points
    assert set(tracking.ways) == set(points)
    assert forms.texts(tracking.table)[0][0] == "1"


def test_a_place_without_tissue_is_told(opened, idle):
    tracking = on.tracking(opened)
    tracking.state.put(0, 1e6, 1e6)
    idle()
    assert "nothing is reconstructed" in forms.texts(tracking.table)[0][2]


def test_exported_tracks_come_back_and_are_scored(tracked, idle, tmp_path, monkeypatch, screenshot):
    tracking, session = on.tracking(tracked), tracked.session
    queries = [point.queries[0] for point in tracking.state.points]
    found = expected(tracked, *queries)
    for name in ("tracks.csv", "tracks.json"):
        monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *args, name=name: (str(tmp_path / name), ""))
        tracked.registry.run("tracks.export")
    with (tmp_path / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["frame"], row["point"]) for row in rows] == [(str(t), str(k)) for t in range(session.frames) for k in (1, 2)]
    numbers = np.array([[float(row[name]) for name in ("x", "y", "X", "Y", "Z")] for row in rows]).reshape(-1, 2, 5)
    np.testing.assert_allclose(numbers[..., :2], found.pixels.swapaxes(0, 1), rtol=1e-4)
    np.testing.assert_allclose(numbers[..., 2:], found.positions.swapaxes(0, 1), rtol=1e-4, atol=1e-4)
    assert [row["visible"] == "1" for row in rows] == found.visible.T.ravel().tolist()

    (tmp_path / "queries.csv").write_text("frame,x,y\n" + "".join(f"{t},{x!r},{y!r}\n" for t, x, y in queries))
    arguments = ["track", str(session.scene.run.path), "--points", str(tmp_path / "queries.csv"), "--json", str(tmp_path / "cli.json")]
    assert not main(arguments)
    ours, theirs = (json.loads((tmp_path / name).read_text()) for name in ("tracks.json", "cli.json"))
    assert ours["unit"] == theirs["unit"]
    assert ours["points"] == theirs["points"]

    # A file with two points seen in frame 0, of which one is, from frame 5 on, 10 px off: beyond the thresholds 4 and 8 only.
    known, starts = tmp_path / "known.json", np.array([queries[0], (0, *found.pixels[1, 0])])
    labels = follow_points(session.scene, starts).pixels
    labels[1, 5:, 0] += 10
    known.write_text(json.dumps({str(t): labels[:, t].tolist() for t in range(session.frames)}))
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *args: (str(known), ""))
    tracked.registry.run("tracks.compare")
    idle()
    words, later = tracking.scores.text(), session.frames - 1
    assert words.startswith("known.json: 2 points")
    assert f"δ {1 - 2 * (session.frames - 5) / (2 * later * 5):.1%}" in words
    screenshot(tracked, "tracks-compared")
    known.write_text("{}")
    tracked.registry.run("tracks.compare")
    idle()
    assert tracking.scores.text() == words
    assert "says of no point where it is" in tracked.findChild(QMessageBox, "error").text()


@pytest.mark.parametrize("visible", [True, False])
def test_a_mark_has_the_number_of_its_row(qapp, visible):
    """Beside the point, as in 3D and in the table."""
    drawn: list[tuple[QRectF, str]] = []

    class Painter(QPainter):
        def drawText(self, place, flags, text) -> None:
            drawn.append((place, text))

    canvas = QImage(200, 100, QImage.Format.Format_RGB32)
    panel = RenderPanel()
    panel.resize(200, 100)
    panel.set_image(np.zeros((100, 200, 3), np.uint8))
    with Painter(canvas) as painter:
        paint_mark(painter, panel.zoom, Mark(7, QColor("red"), np.array([[10.0, 10.0], [60.0, 50.0]]), visible), chosen=False)
    [(place, text)] = drawn
    at = panel.zoom.to_widget(QPointF(60.0, 50.0))
    assert text == "7"
    assert not place.contains(at)
    assert QLineF(place.center(), at).length() < 40
    panel.deleteLater()
