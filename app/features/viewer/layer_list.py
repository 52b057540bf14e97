"""Which layers make up the frame, in which order, and how opaque each is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QKeyEvent, QResizeEvent
from PySide6.QtWidgets import QLabel, QListWidget, QListWidgetItem, QSizePolicy, QSlider, QWidget

from degense.engine.layer_titles import with_unit
from degense.widgets import forms
from degense.widgets.keys import ARROWS, PRESS, keep_keys

#: The row of the masks of the prompts, which always lie on top.
MASKS = "masks of the prompts"
#: Rows that are seen however little room there is.
FEWEST_ROWS = 4
#: Pixels of a row above and below its text.
ROOM = 5
_NAME = Qt.ItemDataRole.UserRole


@dataclass(frozen=True)
class LayerRow:
    """A layer in the list."""

    name: str
    visible: bool
    opacity: float  # in [0, 1]


class _Rows(QListWidget):
    """The list itself. Space ticks, Enter shows alone, Alt with the arrows moves, and so does dragging."""

    toggled = Signal(str, bool)
    picked = Signal(str)  # a row was clicked beside its box
    shown_alone = Signal(str)
    moved = Signal(str, int)  # (name, row) a layer shall stand there

    def __init__(self) -> None:
        super().__init__()
        self.setAccessibleName("Layers, the topmost first")
        self.setDragDropMode(QListWidget.DragDropMode.InternalMove)
        self.setDefaultDropAction(Qt.DropAction.MoveAction)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setUniformItemSizes(True)
        self._ticked = ""  # the row whose box was just pressed
        self.itemChanged.connect(self._tick)
        self.itemClicked.connect(self._pick)
        self.itemDoubleClicked.connect(self._show_alone)
        self.model().rowsMoved.connect(self._dropped, Qt.ConnectionType.QueuedConnection)
        keep_keys(self, ARROWS | PRESS)

    def names(self) -> list[str]:
        return [self.item(row).data(_NAME) for row in range(self.count())]

    def sizeHint(self) -> QSize:
        return QSize(200, self._height(max(self.count(), 1)))

    def minimumSizeHint(self) -> QSize:
        return QSize(120, self._height(FEWEST_ROWS))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """With less room the current row stays in sight."""
        super().resizeEvent(event)
        if (item := self.currentItem()) is not None:
            self.scrollToItem(item)

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange:
            self.setMaximumHeight(self.sizeHint().height())

    def _height(self, rows: int) -> int:
        return rows * max(self.sizeHintForRow(0), self.fontMetrics().height()) + 2 * self.frameWidth()

    def _tick(self, item: QListWidgetItem) -> None:
        self._ticked = item.data(_NAME)
        self.toggled.emit(item.data(_NAME), item.checkState() == Qt.CheckState.Checked)

    def _pick(self, item: QListWidgetItem | None) -> None:
        """A click. There is no row where its box was clicked, as `LayerList.set_layers` has laid the rows anew since the press."""
        ticked, self._ticked = self._ticked, ""
        if item is not None and item.data(_NAME) not in (ticked, MASKS):
            self.picked.emit(item.data(_NAME))

    def _show_alone(self, item: QListWidgetItem | None) -> None:
        if item is not None and item.data(_NAME) != MASKS:
            self.shown_alone.emit(item.data(_NAME))

    def _dropped(self) -> None:
        """A row was dragged: the masks stay on top, whatever was dropped above them."""
        item = self.currentItem()
        if item is not None and item.data(_NAME) != MASKS:
            others = [name for name in self.names() if name not in (MASKS, item.data(_NAME))]
            above = [name for name in self.names()[: self.row(item)] if name in others]
            self.moved.emit(item.data(_NAME), 1 + len(above))

    def event(self, event: QEvent) -> bool:
        """Alt with the arrows is the list's own while it has the focus, and no shortcut of the window."""
        alt, ways = Qt.KeyboardModifier.AltModifier, (Qt.Key.Key_Up, Qt.Key.Key_Down)
        moving = isinstance(event, QKeyEvent) and bool(event.modifiers() & alt) and event.key() in ways
        if event.type() == QEvent.Type.ShortcutOverride and moving:
            event.accept()
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        item, key = self.currentItem(), event.key()
        if item is None:
            return
        if key in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self._show_alone(item)
        elif event.modifiers() & Qt.KeyboardModifier.AltModifier and key in (Qt.Key.Key_Up, Qt.Key.Key_Down):
            row = self.row(item) + (1 if key == Qt.Key.Key_Down else -1)
            if item.data(_NAME) != MASKS and 1 <= row < self.count():
                self.moved.emit(item.data(_NAME), row)
        else:
            super().keyPressEvent(event)
            self._ticked = ""


class LayerList(QWidget):
    """Layers with a box that shows them, the topmost first, and the opacity of the current one. Setters emit nothing."""

    chosen = Signal(str)  # the user wants this layer's numbers; it is shown when it is not
    shown_alone = Signal(str)
    toggled = Signal(str, bool)
    opacity_changed = Signal(str, float)
    moved = Signal(str, int)  # (name, place) 0 is the lowest
    masks_toggled = Signal(bool)
    masks_opacity_changed = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Layers")
        self._tips: dict[str, str] = {}
        self._opacities: dict[str, float] = {}
        self._lowest = self._chosen = ""
        self.rows = _Rows()
        self.rows.toggled.connect(self._toggle)
        self.rows.picked.connect(self.chosen)
        self.rows.shown_alone.connect(self.shown_alone)
        self.rows.moved.connect(lambda name, row: self.moved.emit(name, self.rows.count() - 1 - row))
        self.rows.currentItemChanged.connect(lambda *_: self._show_opacity())
        self._slider = QSlider(Qt.Orientation.Horizontal, self)
        self._slider.setRange(0, 100)
        self._slider.setPageStep(10)
        self._slider.setMinimumWidth(60)
        self._slider.valueChanged.connect(self._opacity_moved)
        keep_keys(self._slider, ARROWS)
        self._percent = QLabel(self)
        self._percent.setMinimumWidth(self.fontMetrics().horizontalAdvance("100 %"))
        self._percent.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        opacity = forms.row(QLabel("Opacity"), (self._slider, 1), self._percent)
        forms.column(self.rows, opacity, margin=0, spacing=4, parent=self)
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Maximum)  # no higher than its rows
        self._show_opacity()

    def set_titles(self, layers: Sequence[tuple[str, str, str, str]]) -> None:
        """Offer these layers: (name, title, unit, description)."""
        with QSignalBlocker(self.rows):
            self.rows.clear()
            masks = (MASKS, "Masks of the prompts", "", "What the prompts find, always on top")
            for name, title, unit, description in (masks, *layers):
                item = QListWidgetItem(with_unit(title, unit))
                item.setData(_NAME, name)
                item.setCheckState(Qt.CheckState.Unchecked)
                self._tips[name] = description
                item.setToolTip(description)
                if name == MASKS:
                    item.setFlags(item.flags() & ~Qt.ItemFlag.ItemIsDragEnabled)
                self.rows.addItem(item)
        self._set_heights()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange and hasattr(self, "rows"):  # also called from the base class's constructor
            self._set_heights()

    def _set_heights(self) -> None:
        """Rows as high as their text."""
        with QSignalBlocker(self.rows):
            for row in range(self.rows.count()):
                self.rows.item(row).setSizeHint(QSize(0, self.fontMetrics().height() + ROOM))
        self.rows.setMaximumHeight(self.rows.sizeHint().height())

    def set_layers(self, layers: Iterable[LayerRow], current: str, masks: tuple[bool, float]) -> None:
        """Show the layers from the bottom up, which one is chosen, and whether masks are shown and how opaque they are."""
        wanted = {MASKS: masks, **{row.name: (row.visible, row.opacity) for row in reversed(list(layers))}}
        before = self.current()
        with QSignalBlocker(self.rows), QSignalBlocker(self.rows.model()):
            items = {name: self.rows.takeItem(0) for name in self.rows.names()}
            for name, (visible, _) in wanted.items():
                items[name].setCheckState(Qt.CheckState.Checked if visible else Qt.CheckState.Unchecked)
                self.rows.addItem(items[name])
            self.rows.setCurrentRow(self.rows.names().index(before if current == self._chosen and before in wanted else current))
        self._chosen = current
        self._opacities = {name: opacity for name, (_, opacity) in wanted.items()}
        drawn = [name for name, (visible, _) in wanted.items() if visible and name != MASKS]
        self._lowest = drawn[-1] if drawn else ""
        self._show_opacity()

    def current(self) -> str:
        """The name of the current row; empty without rows."""
        item = self.rows.currentItem()
        return item.data(_NAME) if item is not None else ""

    def set_available(self, missing: Mapping[str, str]) -> None:
        """Grey layers out, with the reason in their tooltip; those without a reason are offered."""
        with QSignalBlocker(self.rows):
            for name in self.rows.names():
                item, reason = self.rows.item(self.rows.names().index(name)), missing.get(name, "")
                flags = item.flags()
                item.setFlags(flags & ~Qt.ItemFlag.ItemIsEnabled if reason else flags | Qt.ItemFlag.ItemIsEnabled)
                item.setToolTip(f"{self._tips[name]}\n\nNot available: {reason}" if reason else self._tips[name])

    def _toggle(self, name: str, on: bool) -> None:
        if name == MASKS:
            self.masks_toggled.emit(on)
        else:
            self.toggled.emit(name, on)

    def _show_opacity(self) -> None:
        """The opacity of the current row; the lowest layer that is shown covers everything."""
        name = self.current()
        item = self.rows.currentItem()
        what = "masks" if name == MASKS else item.text() if item is not None else "layer"
        lowest = name == self._lowest
        with QSignalBlocker(self._slider):
            self._slider.setValue(100 if lowest else round(100 * self._opacities.get(name, 1.0)))
        self._slider.setEnabled(bool(name) and not lowest)
        tip = "The lowest layer covers everything; tick another one below it first" if lowest else f"Opacity of {what}"
        forms.named(self._slider, f"Opacity of {what}", tip)
        self._percent.setText(f"{self._slider.value()} %")

    def _opacity_moved(self) -> None:
        self._percent.setText(f"{self._slider.value()} %")
        if self.current() == MASKS:
            self.masks_opacity_changed.emit(self._slider.value() / 100)
        else:
            self.opacity_changed.emit(self.current(), self._slider.value() / 100)
