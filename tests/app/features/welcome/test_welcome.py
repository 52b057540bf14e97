"""Task: begin, with nothing open."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QDockWidget, QPushButton, QWidget

from degense.app.features.welcome.page import WelcomePage
from degense.app.features.welcome.samples import INSTRUMENT, PROMPT
from degense.app.features.welcome.thumbnails import thumbnail, thumbnail_file
from degense.app.features.welcome.tour import Tour
from tests.app import installed as on


@pytest.fixture
def page(window) -> WelcomePage:
    return on.found(window, WelcomePage)


@pytest.fixture
def demo(monkeypatch, tmp_path, trained: Path) -> Path:
    """The tiny run in place of the embedded sample."""
    assets = tmp_path / "assets"
    shutil.copytree(trained, assets / "demo" / "run")
    shutil.copytree(trained.with_name("clip"), assets / "demo" / "clip")
    monkeypatch.setattr("degense.app.session.sample.ASSETS", assets)
    return assets / "demo" / "run"


def test_every_way_is_reached_by_keys(qtbot, window, page, screenshot):
    """Tab goes through all of it; only menus and the buttons of the drawer are outside."""
    assert page.isVisible()
    assert not on.viewer(window).panel.isVisible()
    qtbot.waitUntil(window.isActiveWindow)
    page.ways[0].setFocus()
    reached: set[QWidget] = set()
    for _ in range(40):
        focused = window.focusWidget()
        assert focused is not None
        reached.add(focused)
        QTest.keyClick(focused, Qt.Key.Key_Tab)
    assert {*page.ways, *page.tasks, page.tour} <= reached
    screenshot(window, "welcome")


def test_recent_work_has_pictures_and_opens_by_enter(qtbot, window, page, idle, run, own_folders, screenshot):
    on.documents(window).open_path(run)
    idle()
    assert not page.isVisible()
    assert on.viewer(window).panel.isVisible()
    assert thumbnail_file(run).is_file()
    assert not thumbnail(run).isNull()
    qtbot.keyClick(window, Qt.Key.Key_W, Qt.KeyboardModifier.ControlModifier)
    idle()
    assert page.isVisible()
    assert not on.dock(window, "Layers").isVisible()
    screenshot(window, "welcome-recent")
    page.recent.setFocus()
    page.recent.setCurrentRow(0)
    QTest.keyClick(page.recent, Qt.Key.Key_Return)
    idle()
    assert window.session.scene is not None
    assert on.dock(window, "Layers").isVisible()


def test_a_damaged_picture_is_no_picture(tmp_path, own_folders, qapp):
    file = thumbnail_file(tmp_path / "run")
    file.parent.mkdir(parents=True)
    file.write_bytes(b"no picture")
    assert thumbnail(tmp_path / "run").isNull()


def test_what_moved(qtbot, window, page, idle, demo, screenshot):
    """The demo opens with a prompt, and displacement over the colours; the tour comes once."""
    QTest.mouseClick(page.tasks[0], Qt.MouseButton.LeftButton)
    idle()
    state = window.session.view_state
    assert [blend.name for blend in state.drawn] == ["rgb", "displacement"]
    assert [prompt.text for prompt in state.prompts] == [PROMPT]
    view = on.viewer(window).view
    assert view.layer == "displacement"
    assert view.masks is not None
    assert window.session.frame > 0
    tour = window.findChild(Tour)
    qtbot.waitUntil(window.isActiveWindow)
    assert window.focusWidget() is tour.next
    for step in range(5):
        assert tour._count.text() == f"{step + 1} of 5"
        assert window.rect().contains(tour.geometry())
        screenshot(window, f"tour-{step + 1}")
        QTest.keyClick(tour.next, Qt.Key.Key_Space if step % 2 else Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: window.findChild(Tour) is None)
    assert window.settings.value.toured
    window.registry.run("file.close")
    QTest.keyClick(page.ways[3], Qt.Key.Key_Space)
    idle()
    assert window.focusWidget() is on.viewer(window).panel  # whose keys step through time, and no button of the drawer
    assert window.session.scene is not None
    assert window.findChild(Tour) is None
    window.registry.run("help.tour")
    QTest.keyClick(window.findChild(Tour).next, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: window.findChild(Tour) is None)


def test_find_the_grasper(qtbot, window, page, idle, demo):
    window.settings.update(toured=True)
    QTest.mouseClick(page.tasks[1], Qt.MouseButton.LeftButton)
    idle()
    assert [prompt.text for prompt in window.session.view_state.prompts] == [INSTRUMENT]
    assert [blend.name for blend in window.session.view_state.drawn] == ["rgb"]


def test_correct_a_label(qtbot, window, page, idle, demo, screenshot):
    window.settings.update(toured=True)
    QTest.mouseClick(page.tasks[2], Qt.MouseButton.LeftButton)
    idle()
    assert on.annotations(window).tool.active
    assert on.dock(window, "Annotation").isVisible()
    assert not on.viewer(window).splats.isVisible()
    screenshot(window, "correct-a-label")
    window.registry.run("file.close")
    idle()
    assert page.isVisible()
    assert not on.viewer(window).panel.isVisible()


def test_the_tour_stays_above_what_is_opened(qtbot, window, page, idle, demo):
    """All of its card is what lies uppermost there, also after a panel came that the window lays out anew."""
    take = next(button for button in page.findChildren(QPushButton) if button.text() == "Take the tour")
    QTest.mouseClick(take, Qt.MouseButton.LeftButton)
    idle()
    tour = window.findChild(Tour)
    for title in ("Curves", "Tracks", "Areas"):
        window.docks.bring(next(dock for dock in window.findChildren(QDockWidget) if dock.windowTitle() == title))
        idle()
        qtbot.wait(400)  # the panel slides in
        area = tour.geometry()
        for place in (area.topLeft(), area.center(), area.bottomRight()):
            inside = QPoint(min(max(place.x(), area.left() + 3), area.right() - 3), min(max(place.y(), area.top() + 3), area.bottom() - 3))
            shown = window.childAt(inside)
            assert shown is tour or tour.isAncestorOf(shown), (title, shown)


def test_taking_the_tour_again(qtbot, window, page, idle, demo):
    window.settings.update(toured=True)
    take = next(button for button in page.findChildren(QPushButton) if button.text() == "Take the tour")
    QTest.mouseClick(take, Qt.MouseButton.LeftButton)
    idle()
    tour = window.findChild(Tour)
    QTest.mouseClick(tour.skip, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: window.findChild(Tour) is None)
