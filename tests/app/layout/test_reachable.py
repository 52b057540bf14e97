"""Every control of every panel can be reached and read: on small and large screens, with text of any size."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtCore import QPoint, QRect
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDockWidget,
    QLabel,
    QLineEdit,
    QListWidget,
    QScrollArea,
    QScrollBar,
    QStyle,
    QStyleOptionComboBox,
    QTableWidget,
    QTabWidget,
    QWidget,
)

from degense.widgets.theme import apply_text_size
from tests.app import installed as on

CONTROLS = (QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, QLabel, QLineEdit)


@pytest.fixture(params=[1.0, 1.5, 2.0])
def text_size(request, qapp):
    yield request.param
    apply_text_size(qapp, 1.0)


def controls(panel: QWidget) -> Iterator[QWidget]:
    """What can be used or read in a panel and is shown; parts of other controls aside."""
    for control in panel.findChildren(QWidget):
        composed = isinstance(control.parentWidget(), QComboBox | QAbstractSpinBox | QAbstractScrollArea | QLineEdit)
        if isinstance(control, CONTROLS) and not isinstance(control, QScrollBar) and control.isVisible() and not composed:
            yield control


def unreadable(control: QWidget) -> bool:
    """Whether its text is cut where nothing else tells it."""
    metrics = control.fontMetrics()
    if isinstance(control, QComboBox):
        option = QStyleOptionComboBox()
        control.initStyleOption(option)
        part = QStyle.SubControl.SC_ComboBoxEditField
        field = control.style().subControlRect(QStyle.ComplexControl.CC_ComboBox, option, part, control)
        return metrics.horizontalAdvance(control.currentText()) > field.width() + 1
    if isinstance(control, QLineEdit):
        text = control.text() or control.placeholderText()
        return metrics.horizontalAdvance(text) > control.width() and not control.toolTip()
    if isinstance(control, QLabel) and (control.wordWrap() or control.hasScaledContents()):
        return control.height() + 1 < control.heightForWidth(control.width())
    text = control.text().replace("&", "") if isinstance(control, QLabel | QAbstractButton) else ""
    width = max(map(metrics.horizontalAdvance, text.splitlines()), default=0)
    return width > control.width() + 1 and text.splitlines()[0] not in control.toolTip()


def overlapping(panel: QWidget) -> list[str]:
    """Lists and tables whose rows are lower than their text."""
    views = [
        view for kind in (QListWidget, QTableWidget) for view in panel.findChildren(kind) if view.isVisible() and view.model().rowCount()
    ]
    return [view.accessibleName() for view in views if view.visualRect(view.model().index(0, 0)).height() < view.fontMetrics().height()]


def out_of_reach(dock: QDockWidget) -> list[str]:
    """Controls of a panel that are cut at its edges, however it is scrolled up and down, or that cannot be read."""
    area = dock.widget()
    inside = area.viewport() if isinstance(area, QScrollArea) else area
    panel = area.widget() if isinstance(area, QScrollArea) else area
    found = []
    for control in controls(panel):
        place = QRect(control.mapTo(panel, QPoint()), control.size())
        hidden = place.left() < 0 or place.right() >= inside.width() or place.top() < 0 or place.bottom() >= panel.height()
        if hidden or unreadable(control):
            name = control.accessibleName() or (control.text() if hasattr(control, "text") else "")
            found.append(f"{type(control).__name__} {name!r} at {place.getRect()} of {inside.width()} × {panel.height()}")
    return found + overlapping(panel)


def bars_in_bars(window: QWidget) -> list[str]:
    """Areas that can be scrolled up and down inside of others that can."""
    areas = [area for area in window.findChildren(QAbstractScrollArea) if area.isVisible() and area.verticalScrollBar().isVisible()]
    return [
        f"{inner.accessibleName()} in {outer.accessibleName()}"
        for outer in areas
        for inner in areas
        if outer is not inner and outer.isAncestorOf(inner)
    ]


def look_into(window, dock: QDockWidget, qtbot) -> None:
    window.docks.bring(dock)
    qtbot.wait(50)
    assert not out_of_reach(dock), dock.objectName()
    assert not bars_in_bars(window), dock.objectName()


@pytest.mark.parametrize("size", [(1024, 700), (1600, 1000), (3840, 2160)])
def test_every_control_of_every_panel_can_be_reached(qtbot, opened, qapp, idle, text_size, size, screenshot):
    opened.resize(*size)
    apply_text_size(qapp, text_size)
    opened.session.view.set_layer("displacement")
    for word in ("liver", "gallbladder"):
        opened.session.view.add_prompt(word)
    idle()
    qtbot.wait(100)
    for drawer_is_open in (False, True):
        if drawer_is_open:
            opened.docks.bring(opened.docks.drawer[0])
            qtbot.wait(100)
        for name in ("Layers", "Prompts"):
            look_into(opened, on.dock(opened, name), qtbot)
    screenshot(opened, f"reachable-{size[0]}-{round(100 * text_size)}")
    for dock in opened.docks.drawer:
        look_into(opened, dock, qtbot)
    opened.docks.toggle_drawer()
    opened.registry.run("annotate.mode")
    idle()
    qtbot.wait(100)
    pages = on.annotator(opened).panel.findChild(QTabWidget)
    for page in range(pages.count()):
        pages.setCurrentIndex(page)
        look_into(opened, on.dock(opened, "Annotation"), qtbot)
    assert (opened.width(), opened.height()) == size


@pytest.mark.parametrize("resized", ["on the welcome page", "after the run was saved"])
def test_the_column_is_as_wide_as_larger_text_needs(qtbot, window, qapp, idle, run, resized):
    """Where no panel was open as the text became larger, and where a run was saved with smaller text."""
    window.resize(1024, 700)
    try:
        if resized == "after the run was saved":
            on.documents(window).open_path(run)
            idle()
            window.session.view.add_prompt("liver")
            window.registry.run("file.save")
            idle()
            window.registry.run("file.close")
        apply_text_size(qapp, 2.0)
        qtbot.wait(100)
        on.documents(window).open_path(run)
        idle()
        qtbot.wait(100)
        window.session.view.set_layer("displacement")
        window.session.view.add_prompt("gallbladder")
        idle()
        for name in ("Layers", "Prompts"):
            look_into(window, on.dock(window, name), qtbot)
        assert (window.width(), window.height()) == (1024, 700)
    finally:
        apply_text_size(qapp, 1.0)


def test_panels_stand_in_tabs_where_there_is_no_room_for_both(qtbot, opened, idle):
    """And below each other again where there is; a prompt that is added moves nothing."""
    layers, prompts = on.dock(opened, "Layers"), on.dock(opened, "Prompts")
    opened.resize(1024, 640)
    qtbot.wait(100)
    assert not opened.tabifiedDockWidgets(layers)
    opened.docks.bring(opened.docks.drawer[0])
    qtbot.waitUntil(lambda: opened.tabifiedDockWidgets(layers) == [prompts])
    prompts.raise_()
    qtbot.wait(200)
    place = prompts.geometry()
    opened.session.view.add_prompt("liver")
    idle()
    assert prompts.geometry() == place
    opened.docks.toggle_drawer()
    qtbot.waitUntil(lambda: not opened.tabifiedDockWidgets(layers))
    assert layers.geometry().bottom() < prompts.geometry().top()
    assert QApplication.activeWindow() is not None
