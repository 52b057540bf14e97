"""WCAG 2.2 AA as it is painted: text in every state is 4.5 : 1 against what lies under it; what is chosen is 3 : 1 against what is not."""

from __future__ import annotations

from collections import Counter

import pytest
from PySide6.QtCore import QItemSelectionModel, QPoint, QRect, Qt
from PySide6.QtGui import QColor, QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QLineEdit,
    QListWidget,
    QMenu,
    QTableWidget,
    QTableWidgetItem,
    QTabWidget,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from degense.widgets.theme import apply_theme
from tests.widgets.contrast.test_theme import contrast

WORD, TEXT, PART = "HEMLH", 4.5, 3.0


@pytest.fixture(params=["dark", "light"])
def themed(request, qapp, show):
    """A window with large letters, whose stems are painted in their own colour, and a field that takes the keyboard from the others."""
    apply_theme(qapp, request.param)
    window = QWidget()
    font = window.font()
    font.setPointSizeF(1.6 * font.pointSizeF())
    window.setFont(font)
    QVBoxLayout(window).addWidget(QLineEdit(WORD))
    return show(window, 500, 300)


def put(window: QWidget, widget: QWidget) -> None:
    window.layout().addWidget(widget)
    widget.show()
    QTest.qWait(50)


def counted(image: QImage, place: QRect) -> Counter[int]:
    inside = place.intersected(image.rect())
    return Counter(image.pixel(x, y) for x in range(inside.left(), inside.right()) for y in range(inside.top(), inside.bottom()))


def ground(image: QImage, place: QRect) -> QColor:
    """The colour of most pixels."""
    return QColor(counted(image, place).most_common(1)[0][0])


def readable(image: QImage, place: QRect) -> float:
    """Contrast of what stands out most in a place."""
    colours = counted(image, place)
    below = QColor(colours.most_common(1)[0][0])
    return max(contrast(QColor(colour), below) for colour, count in colours.items() if count > 5)


def view_of(kind: type[QAbstractItemView]) -> QAbstractItemView:
    if issubclass(kind, QTableWidget):
        table = QTableWidget(3, 1)
        for row in range(3):
            table.setItem(row, 0, QTableWidgetItem(WORD))
        return table
    if issubclass(kind, QTreeWidget):
        tree = QTreeWidget()
        for _ in range(3):
            QTreeWidgetItem(tree, [WORD])
        return tree
    rows = QListWidget()
    rows.addItems([WORD] * 3)
    return rows


@pytest.mark.parametrize("kind", [QListWidget, QTableWidget, QTreeWidget])
def test_rows(themed, kind):
    view = view_of(kind)
    put(themed, view)
    chosen, other = (view.visualRect(view.model().index(row, 0)) for row in (1, 0))
    view.selectionModel().setCurrentIndex(view.model().index(1, 0), QItemSelectionModel.SelectionFlag.ClearAndSelect)
    for keyboard in (view, themed.findChild(QLineEdit)):
        keyboard.setFocus()
        for pointer in (chosen, other):
            QTest.mouseMove(view.viewport(), pointer.center())
            QTest.qWait(50)
            image = view.viewport().grab().toImage()
            for row in (chosen, other):
                assert readable(image, row) >= TEXT, (keyboard, pointer, row)
            assert contrast(ground(image, chosen), ground(image, other)) >= PART, (keyboard, pointer)


def test_the_rows_of_a_menu_to_choose_from(themed):
    box = QComboBox()
    box.addItems([WORD] * 3)
    put(themed, box)
    assert readable(box.grab().toImage(), box.rect().adjusted(4, 4, -30, -4)) >= TEXT
    box.showPopup()
    view = box.view()
    view.setCurrentIndex(view.model().index(1, 0))
    QTest.qWait(50)
    image = view.viewport().grab().toImage()
    chosen, other = (view.visualRect(view.model().index(row, 0)) for row in (1, 2))
    assert readable(image, chosen) >= TEXT
    assert readable(image, other) >= TEXT
    assert contrast(ground(image, chosen), ground(image, other)) >= PART
    box.hidePopup()


def test_the_entries_of_a_menu(themed):
    menu = QMenu(themed)
    chosen, other = menu.addAction(WORD), menu.addAction(WORD)
    menu.popup(themed.mapToGlobal(QPoint(5, 5)))
    menu.setActiveAction(chosen)
    QTest.qWait(50)
    image = menu.grab().toImage()
    places = [menu.actionGeometry(action) for action in (chosen, other)]
    assert all(readable(image, place) >= TEXT for place in places)
    assert contrast(*(ground(image, place) for place in places)) >= PART
    menu.close()


def test_tabs(themed):
    """A line of the chosen tab stands out as no line of the others does, also of one pointed at; with the keyboard all of it does."""
    pages = QTabWidget()
    for _ in range(3):
        pages.addTab(QWidget(), WORD)
    put(themed, pages)
    bar = pages.tabBar()

    def lines(image: QImage, place: QRect) -> int:
        """Rows of pixels that are 3 : 1 against the middle of the tab, from its left to its right."""
        below, columns = ground(image, place), range(place.left() + 4, place.right() - 4)
        rows = range(place.top(), place.bottom() + 1)
        return sum(all(contrast(image.pixelColor(x, y), below) >= PART for x in columns) for y in rows)

    for keyboard in (themed.findChild(QLineEdit), bar):
        keyboard.setFocus(Qt.FocusReason.TabFocusReason)
        for pointer in range(3):
            QTest.mouseMove(bar, bar.tabRect(pointer).center())
            QTest.qWait(50)
            image = bar.grab().toImage()
            texts = [readable(image, bar.tabRect(tab).adjusted(6, 6, -6, -6)) for tab in range(3)]
            assert min(texts) >= TEXT, (keyboard, pointer)
            if keyboard is bar:
                grounds = [ground(image, bar.tabRect(tab)) for tab in range(3)]
                assert min(contrast(grounds[0], other) for other in grounds[1:]) >= PART, pointer
            else:
                assert [lines(image, bar.tabRect(tab)) >= 2 for tab in range(3)] == [True, False, False], pointer
