"""A menu of colours: those of the classes, and any other."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QColorDialog, QMenu, QWidget

from degense.widgets.theme import CLASS_COLOURS


def colour_menu(parent: QWidget, chosen: Callable[[QColor], object]) -> QMenu:
    """`chosen` gets the colour that the user takes, at once or from the dialog behind the last entry."""
    menu = QMenu(parent)
    for code in CLASS_COLOURS:
        pixmap = QPixmap(16, 16)
        pixmap.fill(QColor(code))
        menu.addAction(QIcon(pixmap), code, lambda code=code: chosen(QColor(code)))
    menu.addSeparator()

    def ask() -> None:
        dialog = QColorDialog(parent)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.colorSelected.connect(chosen)
        dialog.open()

    menu.addAction("Another colour…", ask)
    return menu
