"""Every theme can be read, and colours tell classes apart."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from PySide6.QtGui import QAction, QColor, QImage, QPalette
from PySide6.QtWidgets import QCheckBox, QListWidget, QMainWindow, QPushButton, QStyle, QToolButton, QWidget

from degense.app.shell.status_bar import StatusBar
from degense.widgets.theme import (
    CLASS_COLOURS,
    LABEL_COLOURS,
    THEMES,
    apply_text_size,
    apply_theme,
    class_colour,
    error_colour,
    frame_background,
    is_dark,
    label_colour,
)

ROLE = QPalette.ColorRole


def contrast(a: QColor, b: QColor) -> float:
    """WCAG 2 contrast ratio."""

    def luminance(colour):
        channels = np.array([colour.redF(), colour.greenF(), colour.blueF()])
        linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    low, high = sorted([luminance(a), luminance(b)])
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("name", THEMES)
def test_text_stands_out(qapp, name):
    apply_theme(qapp, name)
    palette = qapp.palette()
    pairs = [(ROLE.WindowText, ROLE.Window), (ROLE.Text, ROLE.Base), (ROLE.Text, ROLE.AlternateBase), (ROLE.ButtonText, ROLE.Button)]
    pairs += [(ROLE.ToolTipText, ROLE.ToolTipBase), (ROLE.Link, ROLE.Window), (ROLE.LinkVisited, ROLE.Window)]
    pairs += [(ROLE.HighlightedText, ROLE.Highlight), (ROLE.ButtonText, ROLE.Mid), (ROLE.ButtonText, ROLE.Midlight)]
    pairs += [(ROLE.PlaceholderText, ground) for ground in (ROLE.Window, ROLE.Base, ROLE.AlternateBase, ROLE.Button)]
    for text, ground in pairs:
        assert contrast(palette.color(text), palette.color(ground)) >= 4.5, (text, ground)
    for ground in (ROLE.Window, ROLE.Button):
        assert contrast(error_colour(palette), palette.color(ground)) >= 4.5
    assert contrast(palette.color(ROLE.PlaceholderText), frame_background(palette)) >= 4.5
    assert contrast(palette.color(ROLE.Accent), palette.color(ROLE.Window)) >= 3.0  # of what has the focus


@pytest.mark.parametrize("name", ["dark", "light"])
def test_signs_stand_out(qapp, name):
    """WCAG 2.2 AA, 1.4.11: what is no text but has to be seen is 3 : 1 against what lies around it."""
    apply_theme(qapp, name)
    palette = qapp.palette()
    for ground in (ROLE.Window, ROLE.Base, ROLE.AlternateBase, ROLE.Button, ROLE.Midlight, ROLE.Mid):  # the frame of what has the focus
        assert contrast(palette.color(ROLE.Accent), palette.color(ground)) >= 3.0, ground
    for kind in LABEL_COLOURS:  # marks of the timeline
        assert contrast(label_colour(kind, palette), palette.color(ROLE.Window)) >= 3.0, kind
    for ground in (ROLE.Base, ROLE.AlternateBase):
        assert contrast(error_colour(palette), palette.color(ground)) >= 4.5
    assert contrast(QColor("white"), QColor(*3 * [255 - 150])) >= 4.5  # the bar over a view, 150 of 255 black, on a white picture


@pytest.mark.parametrize("name", ["dark", "light"])
@pytest.mark.parametrize("role", [ROLE.Window, ROLE.Base, ROLE.Button])
@pytest.mark.parametrize("kind", [QToolButton, QPushButton])
def test_a_pressed_button_stands_out(qtbot, qapp, name, role, kind):
    """WCAG 2.2 AA, 1.4.11: a line of the pressed button, as long as it, is 3 : 1 against the same button released and against its fill."""
    apply_theme(qapp, name)
    ground = QWidget()
    qtbot.addWidget(ground)
    ground.setAutoFillBackground(True)
    ground.setBackgroundRole(role)
    button = kind(ground)
    button.setCheckable(True)
    button.setGeometry(10, 10, 40, 30)
    ground.resize(60, 50)

    def shown(pressed: bool) -> QImage:
        button.setChecked(pressed)
        return ground.grab().toImage()

    released, pressed = shown(False), shown(True)
    fill = pressed.pixelColor(30, 25)
    rows = [[(x, y) for x in range(14, 46)] for y in range(10, 40)]  # without the round corners
    line = [
        row
        for row in rows
        if all(contrast(pressed.pixelColor(*at), other) >= 3.0 for at in row for other in (released.pixelColor(*at), fill))
    ]
    assert len(line) >= 2


def crowded_status_bar(qtbot, width):
    """A window so many pixels wide, with more buttons in its status bar than it has room for."""
    window = QMainWindow()
    qtbot.addWidget(window)
    status = StatusBar(window)
    for number in range(12):
        status.add_button(QAction(f"Panel {number}", window))
    window.resize(width, 100)
    window.show()
    return window, status


@pytest.mark.parametrize("name", ["dark", "light"])
def test_what_a_tool_bar_has_no_room_for_is_found_at_its_end(qtbot, qapp, name):
    """The arrow that opens its menu is drawn whole: 5 columns of pixels or more stand out."""
    apply_theme(qapp, name)
    _, status = crowded_status_bar(qtbot, 300)
    qapp.processEvents()
    arrow = status.more
    assert arrow.isVisible()
    image = arrow.grab().toImage()
    ground = image.pixelColor(0, 0)
    assert sum(any(contrast(image.pixelColor(x, y), ground) >= 3 for y in range(image.height())) for x in range(image.width())) >= 5


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_hints_and_messages_keep_room_and_end_in_dots(qtbot, qapp, factor):
    """However many buttons there are; the tooltip has all of it."""
    apply_text_size(qapp, factor)
    try:
        window, status = crowded_status_bar(qtbot, 1024)
        text = "The whole clip: gallbladder in 24 of 24 frames, 31.6 % of the frame at most; liver in 24 of 24 frames"
        for words in (status.hint, status.message):
            status.hint.setText(text) if words is status.hint else window.statusBar().showMessage(text)
            qapp.processEvents()
            assert words.isVisible()
            assert words.width() >= 20 * words.fontMetrics().averageCharWidth()
            assert words.geometry().right() < status.stripe.geometry().left()
            assert words.toolTip() == text
        assert status.more.isVisible() == (factor == 2.0)
    finally:
        apply_text_size(qapp, 1.0)


@pytest.mark.parametrize("make", [QCheckBox, QListWidget])
def test_boxes_grow_with_the_text(qtbot, qapp, make):
    apply_theme(qapp, "dark")
    sizes = []
    try:
        for factor in (1.0, 2.0):
            apply_text_size(qapp, factor)
            box = make()
            qtbot.addWidget(box)
            box.show()
            sizes.append(box.style().pixelMetric(QStyle.PixelMetric.PM_IndicatorWidth, None, box))
        assert sizes[1] >= 1.8 * sizes[0]
    finally:
        apply_text_size(qapp, 1.0)


@pytest.mark.parametrize("name", ["dark", "light"])
def test_what_cannot_be_used_is_quiet_but_can_be_read(qapp, name):
    apply_theme(qapp, name)
    palette = qapp.palette()
    for role, ground in (
        (QPalette.ColorRole.WindowText, QPalette.ColorRole.Window),
        (QPalette.ColorRole.ButtonText, QPalette.ColorRole.Button),
    ):
        off, on = (palette.color(group, role) for group in (QPalette.ColorGroup.Disabled, QPalette.ColorGroup.Active))
        assert 2.8 <= contrast(off, palette.color(ground)) < 0.7 * contrast(on, palette.color(ground))


def test_a_hint_and_a_message_do_not_overlap(qtbot, qapp):
    """Also after the status bar has been laid out anew."""
    window = QMainWindow()
    qtbot.addWidget(window)
    status = StatusBar(window)
    status.hint.setText("Click both ends")
    window.show()
    window.statusBar().showMessage("24 frames")
    window.statusBar().addPermanentWidget(QPushButton("taller\nthan all"))
    qapp.processEvents()
    assert not status.hint.isVisible()
    window.statusBar().clearMessage()
    assert status.hint.isVisible()


def test_dark_is_dark_and_can_be_left(qapp):
    apply_theme(qapp, "dark")
    assert is_dark(qapp.palette())
    apply_theme(qapp, "light")
    assert not is_dark(qapp.palette())
    with pytest.raises(ValueError, match="sepia"):
        apply_theme(qapp, "sepia")


def test_class_colours_differ():
    assert len(set(CLASS_COLOURS)) == len(CLASS_COLOURS)
    rgb = np.array([[QColor(c).red(), QColor(c).green(), QColor(c).blue()] for c in CLASS_COLOURS], np.uint8)
    lab = cv2.cvtColor(rgb[None].astype(np.float32) / 255, cv2.COLOR_RGB2Lab)[0]
    first = lab[:7]
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(first, 2)) > 25
    assert class_colour(3) == class_colour(3 + len(CLASS_COLOURS))
