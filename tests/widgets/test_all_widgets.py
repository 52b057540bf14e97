"""What holds for every widget: names for those who cannot see it, any theme, any size, nothing left behind."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractButton, QAbstractSlider, QComboBox, QLineEdit, QProgressBar, QWidget

from degense.app.features.history.install import HistoryList
from degense.app.features.inspect.probe_panel import ProbePanel
from degense.app.features.prompts.panel import PromptBar
from degense.app.features.train.monitor import TrainingMonitor
from degense.app.features.viewer.layer_list import LayerList
from degense.widgets.colour_bar import ColourBar
from degense.widgets.curve_plot import CurvePlot
from degense.widgets.frame.render_panel import RenderPanel
from degense.widgets.theme import THEMES, apply_theme
from degense.widgets.timeline import Timeline

CONTROLS = (QAbstractButton, QAbstractSlider, QComboBox, QLineEdit, QProgressBar)


def prompts():
    bar = PromptBar()
    bar.add_prompt("the hook").set_error("“hook” is not known")
    bar.set_decoders([("rnse", "Regions", "")])
    return bar


def layers():
    list_ = LayerList()
    list_.set_titles([("rgb", "Colour", "", "x"), ("depth", "Depth", "mm", "z")])
    return list_


def timeline():
    line = Timeline()
    line.set_frames(30)
    return line


WIDGETS = [prompts, layers, timeline, ColourBar, CurvePlot, HistoryList, ProbePanel, RenderPanel, TrainingMonitor]


@pytest.mark.parametrize("make", WIDGETS)
def test_every_control_has_a_name(show, make):
    widget = show(make())
    assert widget.accessibleName()
    nameless = [
        control
        for control in widget.findChildren(QWidget)
        if isinstance(control, CONTROLS)
        and control.isVisibleTo(widget)
        and control.objectName() not in ("qt_toolbar_ext_button",)
        and not (control.accessibleName() or (isinstance(control, QAbstractButton) and control.text()))
        and not isinstance(control.parent(), QLineEdit)
        and "qt_scrollarea" not in control.parent().objectName()
        and not control.objectName().startswith("qt_")
    ]
    assert nameless == []


@pytest.mark.parametrize("make", WIDGETS)
def test_keyboard_reaches_every_control(show, make):
    widget = show(make())
    deaf = [
        control
        for control in widget.findChildren(QWidget)
        if isinstance(control, (QAbstractButton, QComboBox, QLineEdit))
        and control.isVisibleTo(widget)
        and not control.objectName().startswith("qt_")
        and not isinstance(control.parent(), QLineEdit)
        and not control.focusPolicy() & Qt.FocusPolicy.TabFocus
    ]
    assert deaf == []


@pytest.mark.parametrize("make", WIDGETS)
def test_paints_in_every_theme_and_size(show, qapp, make):
    widget = show(make())
    pictures = []
    for name in THEMES:
        apply_theme(qapp, name)
        for size in ((widget.minimumSizeHint()), widget.sizeHint(), widget.sizeHint() * 2):
            widget.resize(size)
            picture = widget.grab().toImage()
        pictures.append(picture)
    assert pictures[0] != pictures[1]
