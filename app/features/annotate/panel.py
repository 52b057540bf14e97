"""The annotation panel: tools, classes, and the review of frames."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import log2

import numpy as np
from PySide6.QtCore import QEvent, QSignalBlocker, Qt
from PySide6.QtWidgets import (
    QButtonGroup,
    QComboBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QSlider,
    QWidget,
)

from degense.app.features.annotate.class_list import ClassList
from degense.app.features.annotate.review_table import ClassStatistics, ReviewQueue
from degense.app.features.annotate.state import AnnotationState
from degense.app.features.annotate.tool import TOOLS
from degense.app.shell.shell import Shell
from degense.engine.annotation.edits import STATUSES
from degense.engine.annotation.overlay import label_overlay
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError
from degense.widgets import forms
from degense.widgets.elided import ElidedLabel
from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import ARROWS, TYPING, keep_keys

#: Steps of the size slider an octave of the radius.
OCTAVE = 12
SMALLEST = 0.5
TOOL = 32  # least side of the button of a tool, pixels; with larger text it is larger


class AnnotationPanel(QWidget):
    """Shows the annotations and changes them. Its buttons stand for actions of the window."""

    def __init__(self, shell: Shell, state: AnnotationState) -> None:
        super().__init__()
        self.setAccessibleName("Annotation")
        self.shell, self.state, tool = shell, state, state.tool
        self.classes = ClassList(self)
        self.classes.chosen.connect(state.choose_class)
        self.classes.renamed.connect(lambda index, name: self._attempt(lambda: state.rename_class(index, name)))
        self.classes.recoloured.connect(state.recolour_class)
        self.classes.multiplied.connect(lambda index: self._attempt(lambda: state.add_object(index)))
        self._tools = QButtonGroup(self)
        self.buttons: dict[str, QPushButton] = {}
        self._slider = forms.named(QSlider(Qt.Orientation.Horizontal), "Size of the brush", "Size of the brush; keys [ and ]")
        self._slider.setMaximum(8 * OCTAVE - 8)
        self._slider.valueChanged.connect(lambda step: tool.choose(radius=SMALLEST * 2 ** (step / OCTAVE)))
        keep_keys(self._slider, ARROWS)
        self._size = QLabel()
        self._size.setMinimumWidth(self.fontMetrics().horizontalAdvance("200 px "))
        self._new = forms.named(QLineEdit(placeholderText="Another class…"), "Name of another class")
        self._new.returnPressed.connect(self._add_class)
        keep_keys(self._new, TYPING)
        self._lock = self._combo("Paint only inside a class, whatever the tool covers")
        self._lock.activated.connect(lambda row: tool.lock(None if (value := self._lock.itemData(row)) < 0 else value))
        self._status = self._combo("How far the review of this frame is")
        self._status.addItems(STATUSES)
        self._status.activated.connect(lambda row: self._attempt(lambda: state.set_status(STATUSES[row])))
        self.frame, self.summary = ElidedLabel("Frame"), ElidedLabel("Review", secondary=True)
        self.queue, self.statistics = ReviewQueue(state), ClassStatistics(shell, state)
        pages = forms.tabs(Paint=self._paint_page(), Review=self._review_page(), Statistics=self.statistics)
        forms.column(forms.row((self.frame, 1), self._status), (pages, 1), parent=self).setContentsMargins(8, 6, 8, 6)
        shell.started.connect(self._follow_actions)

    def _paint_page(self) -> QWidget:
        page = QWidget()
        forms.column(
            forms.row(*self._tool_buttons(), 0, spacing=2),
            forms.row(QLabel("Size"), (self._slider, 1), self._size),
            (self.classes, 1),
            self._new,
            forms.row(QLabel("Paint only inside"), (self._lock, 1)),
            self._button_row(holes="Fill holes", largest="Largest", prompt="From prompt"),
            parent=page,
        )
        return page

    def _review_page(self) -> QWidget:
        page = QWidget()
        forms.column(
            self._button_row(previous="Previous", next="Next doubtful"),
            self._button_row(accept="Accept", reject="Reject"),
            (self.queue.table, 1),
            self.summary,
            self._button_row(propagate="Propagate to all frames", stop="Stop"),
            self._button_row(accept_all="Accept all", reject_all="Reject all", teach="Train…"),
            parent=page,
        )
        return page

    def _tool_buttons(self) -> list[GlyphButton]:
        for kind in TOOLS:
            button = GlyphButton(kind.name, kind.title, clicked=partial(self.state.tool.choose, kind.name))
            button.setToolTip(f"{kind.title} ({kind.key}): {kind.description}")
            button.setObjectName(kind.name)
            button.setCheckable(True)
            button.setMinimumSize(TOOL, TOOL)
            self._tools.addButton(button)
        return [button for button in self._tools.buttons() if isinstance(button, GlyphButton)]

    def _button_row(self, **buttons: str) -> QHBoxLayout:
        """Buttons for actions of this feature: their names and what stands on them."""
        made = {f"annotate.{name.replace('_', '-')}": text for name, text in buttons.items()}
        self.buttons |= {action: forms.button(text, partial(self._press, action)) for action, text in made.items()}
        return forms.row(*(self.buttons[action] for action in made), spacing=4)

    def _combo(self, tip: str) -> QComboBox:
        box = forms.named(QComboBox(minimumContentsLength=9), tip, tip)
        box.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        return box

    def _follow_actions(self) -> None:
        """Let each button be pressed when the action that it stands for can be done, and show its keys."""
        for name, button in self.buttons.items():
            action = self.shell.menus.actions[name]
            keys = action.shortcut().toString()
            button.setToolTip(f"{action.text()} ({keys})" if keys else action.text())
            button.setEnabled(action.isEnabled())
            action.enabledChanged.connect(button.setEnabled)

    def _press(self, action: str) -> None:
        self.shell.menus.run(action)

    def _attempt(self, change: Callable[[], None]) -> None:
        """Do it, or say why it cannot be done and show the classes as they are."""
        try:
            change()
        except DegenseError as error:
            self.shell.say(str(error))
            self.show_classes()

    def _add_class(self) -> None:
        if name := self._new.text().strip():
            self._new.clear()
            self._attempt(lambda: self.state.add_class(name))

    # State

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange and hasattr(self, "_lock"):  # also called from the base class's constructor
            self.show_classes()

    def show_classes(self) -> None:
        classes = self.state.work.classes if self.state.work is not None else ()
        size = self.classes.swatch_size()
        swatch = np.arange(len(classes), dtype=np.uint8)[:, None, None].repeat(size.height(), 1).repeat(size.width(), 2)
        self.classes.set_classes([(kind.title, _lit(label_overlay(swatch[index], classes))) for index, kind in enumerate(classes)])
        current = self._lock.currentData()
        self._lock.clear()
        for text, value in (("anything", -1), ("unlabelled pixels", UNLABELLED), *((kind.title, i) for i, kind in enumerate(classes))):
            self._lock.addItem(text, value)
        self._lock.setCurrentIndex(max(0, self._lock.findData(current)))
        self.show_tool()

    def show_tool(self) -> None:
        tool = self.state.tool
        for button in self._tools.buttons():
            button.setChecked(button.objectName() == tool.name)
        with QSignalBlocker(self._slider):
            self._slider.setValue(round(OCTAVE * log2(max(1.0, tool.radius / SMALLEST))))
        self._size.setText(f"{2 * tool.radius:.0f} px" if tool.radius >= 1 else "1 px")
        self._lock.setCurrentIndex(max(0, self._lock.findData(-1 if tool.inside is None else tool.inside)))
        self.classes.set_current(tool.label)

    def show_frame(self, frame: int) -> None:
        """Say how a frame is labelled, and how far the review of all is."""
        if (work := self.state.work) is None:
            self.describe("", "open")
            self.summary.setText(self.state.blocked)
            return
        record = work.record(frame)
        if record.proposal is not None:
            text = f"proposed, confidence {record.proposal.confidence:.0%}"
            text += f", {record.proposal.unknown:.1%} of it unknown" if record.proposal.unknown else ""
        elif record.by_hand:
            text = "painted"
        elif record.labels is not None:
            text = "propagated and accepted"
        else:
            clip = self.state.session.clip
            text = "labels of the clip" if clip is not None and frame in clip.labelled_frames else "not labelled"  # without reading them
        self.describe(f"Frame {frame}: {text}", record.status)
        self.queue.show(frame)
        waiting = [proposal for index in work.waiting() if (proposal := work.record(index).proposal) is not None]
        counts = [f"{sum(r.status == status for r in work.records.values())} {status}" for status in STATUSES[1:]]
        doubtful = sum(proposal.doubtful for proposal in waiting)
        proposals = f"; {len(waiting)} wait for an answer, {doubtful} of them doubtful" if waiting else ""
        self.summary.setText(f"{work.count} frames: {', '.join(counts)}{proposals}")

    def describe(self, text: str, status: str) -> None:
        """What is said of the frame that is shown."""
        self.frame.setText(text)
        self._status.setCurrentText(status)


def _lit(overlay: np.ndarray) -> np.ndarray:
    """What a class's overlay uint8 [h, w, 4] looks like on an unlit grey, uint8 [h, w, 4]."""
    alpha = np.clip(overlay[..., 3:] / 255 * 1.5, 0, 1)
    return np.dstack([40 * (1 - alpha) + overlay[..., :3] * alpha, np.full(overlay.shape[:2], 255)]).astype(np.uint8)
