"""Where panels sit: the drawer, the column beside the views, annotating, and that all of it fits the screen."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractScrollArea, QToolButton

from tests.app import installed as on


def button(window, title: str) -> QToolButton:
    return next(b for b in window.status.stripe.findChildren(QToolButton) if b.text() == title)


def press(window, title: str) -> None:
    QTest.mouseClick(button(window, title), Qt.MouseButton.LeftButton)


def open_panels(window) -> list[str]:
    return [dock.objectName() for dock in window.docks.drawer if dock.isVisible()]


def scrollers_in_scrollers(window) -> list[str]:
    """Areas that scroll inside an area that scrolls the same way."""
    areas = [area for area in window.findChildren(QAbstractScrollArea) if area.isVisible()]
    bars = {id(area): (area.horizontalScrollBar().isVisible(), area.verticalScrollBar().isVisible()) for area in areas}
    return [
        f"{inner.accessibleName()} in {outer.accessibleName()}"
        for outer in areas
        for inner in areas
        if outer is not inner and outer.isAncestorOf(inner) and any(a and b for a, b in zip(bars[id(outer)], bars[id(inner)], strict=True))
    ]


def test_the_drawer_opens_one_panel_at_a_time(qtbot, opened, idle, screenshot):
    assert open_panels(opened) == []
    press(opened, "Curves")
    qtbot.wait(50)
    curves = on.dock(opened, "Curves")
    assert open_panels(opened) == ["Curves"]
    assert curves.width() >= opened.width() - 4
    opened.resizeDocks([curves], [260], Qt.Orientation.Vertical)
    qtbot.wait(50)
    height, views = curves.height(), opened.docks.views.geometry()
    press(opened, "Areas")
    qtbot.wait(50)
    assert open_panels(opened) == ["Areas"]
    assert (on.dock(opened, "Areas").height(), opened.docks.views.geometry()) == (height, views)  # nothing jumped
    press(opened, "Areas")
    assert open_panels(opened) == []
    qtbot.keyClick(opened, Qt.Key.Key_J, Qt.KeyboardModifier.ControlModifier)
    qtbot.wait(50)
    assert open_panels(opened) == ["Areas"]
    assert on.dock(opened, "Areas").height() == height
    on.prompts(opened).focus()
    qtbot.keyClicks(on.prompts(opened).bar._field, "liver")
    qtbot.keyClick(on.prompts(opened).bar._field, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: bool(opened.session.view_state.prompts))
    idle()
    on.statistics(opened)._compute_areas()
    idle()
    plot = on.statistics(opened).area_panel.plot
    frames, shares = plot.points("liver")
    assert list(frames) == list(range(10))
    assert ((shares >= 0) & (shares <= 100)).all()
    screenshot(opened, "areas")
    QTest.mouseClick(plot, Qt.MouseButton.LeftButton, pos=QPoint(plot.width() - 12, plot.height() // 2))
    assert opened.session.frame == 9
    opened.session.view.remove_prompt("liver")
    assert not plot.series


def test_the_drawer_is_remembered(qtbot, window, qapp):
    from degense.app.application import FEATURES
    from degense.app.shell.settings import SettingsFile
    from degense.app.shell.shell import Shell

    press(window, "Log")
    window.close()
    again = Shell(SettingsFile(window.settings.path), FEATURES)
    qtbot.addWidget(again)
    again.show()
    qtbot.wait(50)
    assert open_panels(again) == ["Log"]
    assert button(again, "Log").isChecked()
    again.close()


def test_annotating_gives_the_frame_the_whole_width(qtbot, opened, idle, screenshot):
    views, panel, splats = opened.docks.views, on.viewer(opened).panel, on.viewer(opened).splats
    beside = [on.dock(opened, name) for name in ("Layers", "Prompts")]
    sizes, state = views.sizes(), opened.docks.state()
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_A)
    idle()
    assert on.dock(opened, "Annotation").isVisible()
    assert not any(dock.isVisible() for dock in (*beside, splats))
    assert panel.width() >= views.width() - 2
    assert not scrollers_in_scrollers(opened)
    assert opened.docks.state() == state  # what a session keeps is the arrangement without it
    screenshot(opened, "annotating-layout")
    qtbot.keyClick(panel, Qt.Key.Key_A)
    idle()
    assert all(widget.isVisible() for widget in (*beside, splats))
    assert not on.dock(opened, "Annotation").isVisible()
    assert views.sizes() == pytest.approx(sizes, abs=12)


@pytest.mark.parametrize("size", [(1024, 700), (1600, 1000), (3840, 2160)])
def test_everything_fits(qtbot, opened, idle, screenshot, size):
    """Also with the drawer open at any panel and a prompt; nothing scrolls inside what scrolls."""
    opened.resize(*size)
    opened.session.view.add_prompt("liver")
    opened.session.view.set_layer("displacement")
    idle()
    for dock in opened.docks.drawer:
        opened.docks.bring(dock)
        qtbot.wait(20)
        assert (opened.width(), opened.height()) == size, dock.objectName()
        assert not scrollers_in_scrollers(opened), dock.objectName()
        assert opened.docks.views.height() >= 200
    screenshot(opened, f"layout-{size[0]}")
    opened.docks.toggle_drawer()
    qtbot.wait(50)
    for name in ("Layers", "Prompts"):
        area = on.dock(opened, name).widget()
        assert not area.verticalScrollBar().isVisible(), name
        assert not area.horizontalScrollBar().isVisible(), name
    opened.registry.run("annotate.mode")
    idle()
    assert (opened.width(), opened.height()) == size
    area = on.dock(opened, "Annotation").widget()
    assert not area.horizontalScrollBar().isVisible()
    screenshot(opened, f"annotating-{size[0]}")
    opened.registry.run("annotate.mode")
    opened.docks.toggle_drawer()
    qtbot.wait(50)
    opened.registry.run("annotate.mode")
    qtbot.wait(50)
    assert on.dock(opened, "Annotation").isVisible()
    assert (opened.width(), opened.height()) == size


def test_closing_the_drawer_by_its_cross_keeps_its_height(qtbot, opened):
    press(opened, "Facts")
    facts = on.dock(opened, "Facts")
    opened.resizeDocks([facts], [240], Qt.Orientation.Vertical)
    qtbot.wait(50)
    height = facts.height()
    facts.close()
    assert not button(opened, "Facts").isChecked()
    press(opened, "History")
    qtbot.wait(50)
    assert on.dock(opened, "History").height() == height
