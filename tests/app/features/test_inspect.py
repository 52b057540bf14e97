"""Task: find where tissue moved, follow it, hold two runs against each other, and take the numbers away."""

from __future__ import annotations

import csv
import shutil

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, QRectF, Qt
from PySide6.QtWidgets import QComboBox, QFileDialog, QMessageBox

from degense.app.features.inspect.findings_files import LINE, caption
from degense.app.session.targets import Found, Region, Spot, material
from degense.engine.layers import LAYERS, LayerRequest
from degense.widgets import forms
from tests.app import installed as on

LEFT = Qt.MouseButton.LeftButton


def at(panel, x: float, y: float) -> QPoint:
    """Where pixel position (x, y) of the picture lies in the panel."""
    scale, left, top = panel.zoom.view()
    return QPoint(round(panel.width() / 2 + (x - left) * scale), round(panel.height() / 2 + (y - top) * scale))


@pytest.fixture
def saved_as(monkeypatch, tmp_path):
    """The user's answer to each dialog that asks where to save."""

    def answer(name: str):
        path = tmp_path / name
        monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *args: (str(path), ""))
        return path

    return answer


def test_a_region_is_outlined_and_followed(qtbot, opened, idle, screenshot, saved_as):
    session, panel = opened.session, on.viewer(opened).panel
    session.go_to(6)
    session.view.set_layer("speed")
    session.view.add_prompt("gallbladder")
    idle()
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_R)
    qtbot.mousePress(panel, LEFT, pos=at(panel, 30, 25))
    qtbot.mouseMove(panel, at(panel, 50, 40))
    qtbot.mouseMove(panel, at(panel, 66, 55))
    qtbot.mouseRelease(panel, LEFT, pos=at(panel, 66, 55))
    idle()
    place = session.probe
    assert isinstance(place, Region)
    assert np.allclose(place.outline, [(30, 25), (66, 25), (66, 55), (30, 55)], atol=0.3)
    indices, weights = material(session.scene, place)
    speed = LAYERS["speed"].splats(session.scene, LayerRequest(3))[indices]
    assert on.probe(opened).curves.layers["speed"][0, 3] == pytest.approx(speed @ weights, rel=1e-5)
    assert list(on.probe(opened).panel.plot.series) == ["speed [mm/s]"]
    assert np.array_equal(on.viewer(opened).splats._highlight, indices)  # they light up in 3D
    screenshot(opened, "inspect-region")
    assert panel.tool is None
    session.view.set_layer("displacement")
    idle()
    assert list(on.probe(opened).panel.plot.series) == ["displacement [mm]"]
    table = saved_as("curves.csv")
    opened.registry.run("inspect.save-curves")
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert len(rows) == 10
    assert float(rows[3]["speed mean [mm/s]"]) == pytest.approx(speed @ weights, rel=1e-4)
    picture = saved_as("curves.png")
    opened.registry.run("inspect.save-curves")
    assert np.ptp(cv2.imread(str(picture))) > 100
    qtbot.keyClick(panel, Qt.Key.Key_Escape)
    assert session.probe is None
    assert on.viewer(opened).splats._highlight is None


def test_the_mask_of_a_prompt_is_followed(qtbot, opened, idle):
    session, panel = opened.session, on.viewer(opened).panel
    session.view.set_decoder("threshold")
    session.view.add_prompt("gallbladder")
    session.view.add_prompt("liver")
    idle()
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_K)
    idle()
    assert session.probe == Found("gallbladder")
    mask = session.scene.query(4).similarity(session.scene.included("gallbladder")) > 0.5
    assert on.probe(opened).curves.area[4] == pytest.approx(mask.mean())
    session.view.set_threshold(0.9)
    idle()
    assert on.probe(opened).curves.area[4] < mask.mean()  # it follows the threshold
    qtbot.keyClick(panel, Qt.Key.Key_K)
    assert session.probe == Found("liver")
    session.view.remove_prompt("liver")
    assert session.probe is None
    idle()


def test_the_worst_places_are_listed_and_gone_to(qtbot, opened, idle, screenshot, saved_as):
    session, panel, listed = opened.session, on.viewer(opened).panel, on.findings(opened).table
    panel.setFocus()
    assert not opened.menus.actions["inspect.rank"].isEnabled()  # colour has no worst places
    qtbot.keyClick(panel, Qt.Key.Key_6)
    qtbot.keyClick(panel, Qt.Key.Key_W, Qt.KeyboardModifier.ShiftModifier)
    idle()
    findings = on.findings(opened).findings()
    assert len(findings) == len(forms.texts(listed)) > 3
    assert [finding.value for finding in findings] == sorted((finding.value for finding in findings), reverse=True)
    image = LAYERS["displacement"].image(session.scene, LayerRequest(findings[0].frame))
    known = image.values if image.uncertain is None else image.values[~image.uncertain]
    assert findings[0].value == pytest.approx(np.nanpercentile(known, 99))
    assert listed.horizontalHeaderItem(2).text() == "99th percentile [mm]"
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_N)
    idle()
    worst = findings[0]
    assert session.frame == worst.frame
    assert session.probe == Spot(worst.frame, worst.x, worst.y)
    screenshot(opened, "inspect-findings")
    qtbot.keyClick(panel, Qt.Key.Key_N)
    assert session.frame == findings[1].frame
    idle()
    table = saved_as("findings.csv")
    opened.registry.run("inspect.save-findings")
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert [int(row["frame"]) for row in rows] == [finding.frame for finding in findings]
    assert float(rows[0]["99th percentile [mm]"]) == pytest.approx(worst.value, rel=1e-4)
    sheet = saved_as("findings.png")
    opened.registry.run("inspect.save-findings")
    idle()
    picture = cv2.imread(str(sheet))
    assert picture.shape[1] == 4 * 320
    assert np.array_equal(picture[:LINE], caption("Displacement: 99th percentile [mm]", 4 * 320))
    session.view.set_layer("speed")
    assert forms.texts(listed) == []
    idle()


def test_two_places_of_one_frame_are_gone_to(qtbot, opened, idle, screenshot, saved_as):
    """By keys and mouse. The probe's heading and numbers are those of the place that was gone to, never of the one before."""
    session, panel, findings, probe = opened.session, on.viewer(opened).panel, on.findings(opened), on.probe(opened)
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_6)
    qtbot.keyClick(panel, Qt.Key.Key_W, Qt.KeyboardModifier.ShiftModifier)
    idle()
    kinds = on.dock(opened, "Findings").findChild(QComboBox)
    kinds.setFocus()
    qtbot.keyClick(kinds, Qt.Key.Key_Down)
    assert kinds.currentText() == "Worst places"
    assert findings.table.horizontalHeaderItem(2).text() == "Mean around [mm]"
    places = findings.findings()
    first, second = next((a, b) for b in range(len(places)) for a in range(b) if places[a].frame == places[b].frame)
    values = LAYERS["displacement"].image(session.scene, LayerRequest(places[first].frame)).values

    def read() -> dict[str, str]:
        return {row[0]: row[1] for row in forms.texts(probe.panel._table)}

    def belongs(place) -> None:
        assert (session.frame, probe.panel._place.text()) == (
            place.frame,
            f"spot at ({int(place.x)}, {int(place.y)}) of frame {place.frame}",
        )
        assert read().get("position", f"{int(place.x)}, {int(place.y)} px") == f"{int(place.x)}, {int(place.y)} px"  # also at once
        idle()
        assert read()["position"] == f"{int(place.x)}, {int(place.y)} px"
        assert read()["displacement"] == f"{values[int(place.y), int(place.x)]:.3g} mm"

    panel.setFocus()
    for _ in range(first + 1):
        qtbot.keyClick(panel, Qt.Key.Key_N)
    idle()
    for row in (second, first):  # both on one frame
        item = findings.table.item(row, 0)
        findings.table.scrollToItem(item)
        qtbot.mouseClick(findings.table.viewport(), LEFT, pos=findings.table.visualItemRect(item).center())
        belongs(places[row])
    opened.docks.bring(on.dock(opened, "Curves"))
    screenshot(opened, "inspect-places")
    table = saved_as("places.csv")
    opened.registry.run("inspect.save-findings")
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert float(rows[0]["mean around [mm]"]) == pytest.approx(places[0].value, rel=1e-4)


def test_two_runs_side_by_side(qtbot, opened, idle, run, screenshot, tiny_clip):
    session, runs, panel = opened.session, on.comparison(opened), on.viewer(opened).panel
    second = tiny_clip.parent / "second"
    shutil.copytree(run, second)
    session.view.set_layer("displacement")
    session.go_to(5)
    idle()
    runs.open(second)
    idle()
    assert runs.panel.isVisible()
    assert np.array_equal(runs.panel.grab_image(), panel.grab_image())  # the same run looks the same: frame, range, camera
    screenshot(opened, "inspect-two-runs")
    panel.zoom.set_factor(9.0)
    assert runs.panel.zoom.view() == pytest.approx(panel.zoom.view())
    session.go_to(2)
    idle()
    assert runs.view.frame == 2
    before = panel.grab_image()
    on.viewer(opened).splats.setFocus()
    qtbot.keyClick(on.viewer(opened).splats._canvas, Qt.Key.Key_Left, Qt.KeyboardModifier.ControlModifier)  # turn the camera
    qtbot.waitUntil(lambda: session.camera_mode == "free")
    qtbot.wait(200)
    idle()
    assert not np.array_equal(panel.grab_image(), before)
    assert np.array_equal(runs.panel.grab_image(), panel.grab_image())  # through one camera
    session.view.set_layer("rgb")
    idle()
    screenshot(opened, "inspect-two-runs-free")
    assert (panel.grab_image().max(-1) > 30).mean() > 0.7  # as large as the surgeon's frame
    opened.registry.run("inspect.one-run")
    idle()
    assert not runs.panel.isVisible()
    session.view.set_layer("displacement")
    idle()
    assert np.array_equal(panel.grab_image(), before)
    shutil.rmtree(second)


def test_the_frame_stays_fitted_when_panes_open_and_close(qtbot, opened, idle, run, tiny_clip):
    """Also after two runs were compared, and after a frame that is not enlarged was moved."""
    panel, runs, docks = on.viewer(opened).panel, on.comparison(opened), opened.docks
    second = tiny_clip.parent / "second"
    shutil.copytree(run, second)

    def is_fitted(panel) -> bool:
        target = panel.zoom.target()
        inside = QRectF(panel.rect()).adjusted(-1, -1, 1, 1).contains(target)
        return inside and (abs(target.width() - panel.width()) < 1 or abs(target.height() - panel.height()) < 1)

    def opens(dock) -> None:
        for shown in (True, False):
            height = panel.height()
            dock.setVisible(shown)
            qtbot.waitUntil(lambda height=height: panel.height() != height and is_fitted(panel))

    runs.open(second)
    idle()
    qtbot.waitUntil(lambda: is_fitted(panel) and is_fitted(runs.panel))
    opened.registry.run("inspect.one-run")
    opens(on.dock(opened, "Training"))
    panel.zoom.move(QPointF(30, 20))
    assert not is_fitted(panel)
    opens(on.dock(opened, "Log"))
    panel.zoom.set_factor(12.0)
    assert docks.views.isVisible()
    on.dock(opened, "Log").show()
    idle()
    assert panel.zoom.factor() == 12.0  # what was enlarged stays so
    shutil.rmtree(second)


def test_a_run_of_another_clip_is_refused(opened, idle, run, tiny_clip):
    import json

    other = tiny_clip.parent / "other"
    shutil.copytree(run, other)
    info = json.loads((other / "run.json").read_text())
    info["cameras"]["count"], info["cameras"]["viewmats"] = 7, info["cameras"]["viewmats"][:1]
    (other / "run.json").write_text(json.dumps(info))
    on.comparison(opened).open(other)
    idle()
    box = opened.findChild(QMessageBox, "error")
    assert "shows another clip" in box.text()
    box.close()
    assert on.comparison(opened).scene is None
    shutil.rmtree(other)
