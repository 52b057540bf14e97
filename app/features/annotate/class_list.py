"""The list of label classes: swatch, key and name of each; tools paint the current one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPoint, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QColor, QContextMenuEvent, QIcon, QPainter, QPixmap
from PySide6.QtWidgets import QAbstractItemView, QListWidget, QListWidgetItem, QWidget

from degense.widgets.colour_menu import colour_menu
from degense.widgets.qt_images import rgb, to_qimage


class ClassList(QListWidget):
    """One row a class, or an object of it. A double click renames; the menu of the right button recolours and adds objects."""

    chosen = Signal(int)  # (index) by the user
    renamed = Signal(int, str)  # (index, name)
    recoloured = Signal(int, tuple)  # (index, (red, green, blue))
    multiplied = Signal(int)  # (index) another object of this class is wanted

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Label classes")
        self.setToolTip("Keys 1 to 9 choose a class; a double click renames it, the right button recolours it or adds another object")
        self.setEditTriggers(QAbstractItemView.EditTrigger.DoubleClicked | QAbstractItemView.EditTrigger.EditKeyPressed)
        self.currentRowChanged.connect(lambda row: self.chosen.emit(row) if row >= 0 else None)
        self.itemChanged.connect(self._item_changed)
        self.names: list[str] = []

    def swatch_size(self) -> QSize:
        """Of the swatch of a class, in which its key is written."""
        line = self.fontMetrics().height()
        return QSize(line + 6, line)

    def set_classes(self, classes: Sequence[tuple[str, np.ndarray]]) -> None:
        """Show these: names, and swatches uint8 RGBA [h, w, 4]. The current row stays where it can."""
        row = self.currentRow()
        self.setIconSize(self.swatch_size())
        self.names = [name for name, _ in classes]
        with QSignalBlocker(self):
            self.clear()
            for index, (name, swatch) in enumerate(classes):
                item = QListWidgetItem(_icon(swatch, str(index + 1) if index < 9 else ""), name)
                item.setFlags(item.flags() | Qt.ItemFlag.ItemIsEditable)
                self.addItem(item)
            self.setCurrentRow(min(max(row, 0), len(classes) - 1))

    def set_current(self, index: int) -> None:
        with QSignalBlocker(self):
            self.setCurrentRow(index)

    def _item_changed(self, item: QListWidgetItem) -> None:
        row, name = self.row(item), " ".join(item.text().split())
        if name and name != self.names[row]:
            self.renamed.emit(row, name)  # answered by `set_classes`, with the old name where the new one is refused
        else:
            item.setText(self.names[row])

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        """The menu of the row under the mouse, or of the current one by the menu key."""
        by_key = event.reason() == QContextMenuEvent.Reason.Keyboard
        item = self.currentItem() if by_key else self.itemAt(event.pos())
        if item is not None:
            self._show_menu(item, self.visualItemRect(item).bottomLeft() if by_key else event.pos())

    def _show_menu(self, item: QListWidgetItem, position: QPoint) -> None:
        row = self.row(item)
        menu = colour_menu(self, lambda colour: self.recoloured.emit(row, rgb(colour)))
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.addAction("Rename", lambda: self.editItem(self.item(row)))
        menu.addAction(f"Another {item.text()}, as an object of its own", lambda: self.multiplied.emit(row))
        menu.popup(self.viewport().mapToGlobal(position))


def _icon(swatch: np.ndarray, key: str) -> QIcon:
    """A swatch with the key that chooses it."""
    pixmap = QPixmap.fromImage(to_qimage(swatch))
    with QPainter(pixmap) as painter:
        for offset, colour in ((1, QColor(0, 0, 0)), (0, QColor(255, 255, 255))):
            painter.setPen(colour)
            painter.drawText(pixmap.rect().translated(offset, offset), Qt.AlignmentFlag.AlignCenter, key)
    return QIcon(pixmap)
