"""The 2D picture: what is painted, where the pointer is, what the hand does."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QColor, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from degense.widgets import qt_images as images
from degense.widgets.frame import frame_comparison as comparison
from degense.widgets.frame.frame_comparison import COMPARE_MODES, GAIN
from degense.widgets.frame.panel_tools import RegionTool
from degense.widgets.frame.render_panel import RenderPanel
from degense.widgets.qt_images import to_array, to_qimage

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def rgb(rng):
    return rng.integers(0, 256, (60, 80, 3), dtype=np.uint8)


@pytest.fixture
def panel(show, rgb):
    panel = show(RenderPanel(), 400, 300)
    panel.set_image(rgb)
    return panel


def pixels(panel):
    return to_array(panel.grab().toImage())


def at(panel, x, y):
    """The widget position in the middle of an image pixel, with the picture fitted into 400 × 300."""
    scale = panel.zoom.factor() / panel.devicePixelRatioF()
    return QPoint(int((x + 0.5) * scale), int((y + 0.5) * scale))


def wheel(panel, position, clicks):
    at = QPointF(position)
    turn, button, modifier = QPoint(0, 120 * clicks), Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier
    event = QWheelEvent(at, at, QPoint(), turn, button, modifier, Qt.ScrollPhase.NoScrollPhase, False)
    QApplication.sendEvent(panel, event)


def test_high_zoom_shows_exact_pixels(panel, rgb):
    assert panel.zoom.factor() == pytest.approx(5.0)
    shown = pixels(panel)
    np.testing.assert_array_equal(shown[2::5, 2::5], rgb)
    inside = np.s_[2:-2, 2:-2]  # the frame around it shows the focus
    np.testing.assert_array_equal(shown[inside], rgb.repeat(5, 0).repeat(5, 1)[inside])


def test_grab_is_the_picture(panel, rgb):
    panel.marks.set_marker((10, 10))
    panel.marks.set_legend([("liver", QColor("red"))])
    panel.zoom.set_factor(17.0)
    np.testing.assert_array_equal(panel.grab_image(), rgb)
    panel.set_image(None)
    with pytest.raises(ValueError, match="no frame"):
        panel.grab_image()


def test_overlay_blends_with_its_opacity(panel, rgb):
    overlay = np.zeros((60, 80, 4), np.uint8)
    overlay[:30] = (255, 0, 0, 128)
    panel.set_overlay(overlay)
    panel.set_overlay_opacity(0.5)
    alpha = 128 / 255 * 0.5
    expected = rgb[:30] * (1 - alpha) + np.array([255, 0, 0]) * alpha
    assert np.abs(panel.grab_image()[:30] - expected).max() <= 3
    np.testing.assert_array_equal(panel.grab_image()[30:], rgb[30:])
    panel.set_overlay_opacity(0.0)
    np.testing.assert_array_equal(panel.grab_image(), rgb)


def test_wipe_shows_both(panel, rgb, rng):
    observed = rng.integers(0, 256, rgb.shape, dtype=np.uint8)
    panel.comparison.set_observed(observed)
    panel.comparison.set_mode("wipe")
    panel.comparison.set_split(0.25)
    shown = panel.grab_image()
    np.testing.assert_array_equal(shown[:, :20], rgb[:, :20])
    np.testing.assert_array_equal(shown[:, 20:], observed[:, 20:])


def test_difference_is_the_difference(panel, rgb, rng):
    observed = rng.integers(0, 256, rgb.shape, dtype=np.uint8)
    panel.comparison.set_observed(observed)
    panel.comparison.set_mode("difference")
    np.testing.assert_array_equal(panel.grab_image(), np.minimum(GAIN * np.abs(rgb.astype(int) - observed), 255))
    panel.comparison.set_observed(rgb)
    assert panel.grab_image().max() == 0


def test_wipe_handle_by_mouse_and_keys(panel, rgb, qtbot):
    panel.comparison.set_observed(rgb)
    panel.comparison.set_mode("wipe")
    clicks: list = []
    panel.clicked.connect(lambda x, y: clicks.append((x, y)))
    QTest.mousePress(panel, LEFT, Qt.KeyboardModifier.NoModifier, QPoint(200, 200))
    QTest.mouseMove(panel, QPoint(100, 210))
    qtbot.waitUntil(lambda: panel.comparison.split != 0.5)
    QTest.mouseRelease(panel, LEFT, Qt.KeyboardModifier.NoModifier, QPoint(100, 210))
    assert panel.comparison.split == pytest.approx(0.25)
    assert panel.zoom.factor() == pytest.approx(5.0)
    assert clicks == []
    panel.setFocus()
    QTest.keyClick(panel, Qt.Key.Key_BracketRight)
    assert panel.comparison.split == pytest.approx(0.27)
    QTest.keyClick(panel, Qt.Key.Key_BracketLeft, Qt.KeyboardModifier.ShiftModifier)
    assert panel.comparison.split == pytest.approx(0.17)


def test_hover_and_click_name_pixels(panel, qtbot):
    hovered: list = []
    clicked: list = []
    panel.hovered.connect(lambda x, y: hovered.append((x, y)))
    panel.clicked.connect(lambda x, y: clicked.append((x, y)))
    QTest.mouseClick(panel, LEFT, Qt.KeyboardModifier.NoModifier, at(panel, 79, 0))
    QTest.mouseClick(panel, LEFT, Qt.KeyboardModifier.NoModifier, at(panel, 13, 59))
    assert clicked == [(79, 0), (13, 59)]
    QTest.mouseMove(panel, at(panel, 7, 8))
    qtbot.waitUntil(lambda: (7, 8) in hovered)
    panel.leaveEvent(None)
    assert hovered[-1] == (-1, -1)


def test_wheel_zooms_about_the_pointer(panel):
    clicked: list = []
    panel.clicked.connect(lambda x, y: clicked.append((x, y)))
    where = at(panel, 60, 20)
    for clicks in (3, 2, -1):
        wheel(panel, where, clicks)
    assert panel.zoom.factor() > 5
    QTest.mouseClick(panel, LEFT, Qt.KeyboardModifier.NoModifier, where)
    assert clicked == [(60, 20)]


def test_drag_pans_and_double_click_fits(panel, qtbot):
    clicked: list = []
    panel.clicked.connect(lambda x, y: clicked.append((x, y)))
    panel.zoom.set_factor(10.0)
    QTest.mousePress(panel, LEFT, Qt.KeyboardModifier.NoModifier, QPoint(200, 150))
    for x in (220, 250):
        QTest.mouseMove(panel, QPoint(x, 150))
        qtbot.wait(10)
    QTest.mouseRelease(panel, LEFT, Qt.KeyboardModifier.NoModifier, QPoint(250, 150))
    assert clicked == []
    QTest.mouseClick(panel, LEFT, Qt.KeyboardModifier.NoModifier, QPoint(252, 155))
    assert clicked == [(40, 30)]  # what was in the middle moved 50 pixels to the right
    QTest.mouseDClick(panel, LEFT, Qt.KeyboardModifier.NoModifier, QPoint(100, 100))
    assert panel.zoom.factor() == pytest.approx(5.0)


def test_keys_zoom(panel):
    panel.setFocus()
    for key, zoom in ((Qt.Key.Key_1, 1.0), (Qt.Key.Key_Plus, 1.25), (Qt.Key.Key_Minus, 1.0), (Qt.Key.Key_0, 5.0)):
        QTest.keyClick(panel, key)
        assert panel.zoom.factor() == pytest.approx(zoom)


def test_resizing_keeps_the_fit(panel, qtbot):
    panel.resize(800, 600)
    qtbot.waitUntil(lambda: panel.zoom.factor() == pytest.approx(10.0))


def test_message_marker_legend_and_notes_are_painted(panel, rgb):
    plain = pixels(panel)
    panel.marks.set_marker((40, 30))
    marked = pixels(panel)
    assert (marked != plain).any(-1)[120:180, 170:230].any()
    panel.marks.set_marker(None)
    panel.marks.set_legend([("gallbladder", QColor(1, 250, 3))])
    assert (pixels(panel) == [1, 250, 3]).all(-1).sum() > 50
    panel.marks.set_legend([])
    panel.comparison.set_mode("wipe")
    assert (pixels(panel) != plain).any()  # says that there is nothing to compare with
    panel.comparison.set_mode("off")
    np.testing.assert_array_equal(pixels(panel), plain)
    panel.set_image(None)
    panel.set_message("")
    empty = pixels(panel)
    panel.set_message("Open a clip")
    assert (pixels(panel) != empty).any()


def test_wrong_values_are_refused(panel):
    with pytest.raises(ValueError, match="flicker"):
        panel.comparison.set_mode("flicker")
    for bad in (np.zeros((4, 4, 3)), np.zeros((4, 4), np.uint8), np.zeros((4, 4, 2), np.uint8)):
        with pytest.raises(ValueError, match="uint8"):
            panel.set_image(bad)


@pytest.mark.parametrize("mode", COMPARE_MODES)
def test_a_picture_is_converted_once_however_often_it_is_painted(panel, rgb, monkeypatch, mode):
    """Work on every pixel belongs in the setters, never in paintEvent."""
    converted: list[np.ndarray] = []
    for module in (comparison, images):
        monkeypatch.setattr(module, "to_qimage", lambda array: (converted.append(array), to_qimage(array))[1])
    panel.set_image(rgb)
    panel.comparison.set_observed(rgb[::-1].copy())
    panel.comparison.set_mode(mode)
    panel.repaint()
    assert len(converted) == (3 if mode == "difference" else 2)
    panel.repaint()
    panel.zoom.set_factor(2.0)
    panel.repaint()
    assert len(converted) == (3 if mode == "difference" else 2)


def test_blinking_shows_one_then_the_other(panel, rgb, rng, qtbot):
    observed = rng.integers(0, 256, (60, 80, 3), dtype=np.uint8)
    panel.comparison.set_observed(observed)
    panel.comparison.set_mode("blink")
    np.testing.assert_array_equal(panel.grab_image(), rgb)
    qtbot.waitUntil(lambda: np.array_equal(panel.grab_image(), observed))
    qtbot.waitUntil(lambda: np.array_equal(panel.grab_image(), rgb))
    panel.comparison.set_mode("off")


@pytest.mark.parametrize("lasso", [False, True])
def test_a_region_is_drawn_with_the_tool_in_the_hand(panel, qtbot, lasso):
    tool = RegionTool(lasso)
    panel.set_tool(tool)
    clicks, drawn = [], []
    panel.clicked.connect(lambda x, y: clicks.append((x, y)))
    tool.drawn.connect(drawn.append)
    before = panel.zoom.view()
    qtbot.mousePress(panel, LEFT, pos=at(panel, 10, 10))
    for x, y in ((30, 12), (40, 40), (12, 35)):
        qtbot.mouseMove(panel, at(panel, x, y))
    qtbot.mouseRelease(panel, LEFT, pos=at(panel, 12, 35))
    [outline] = drawn
    assert clicks == []
    assert panel.zoom.view() == before  # nothing was panned
    xs, ys = zip(*outline, strict=True)
    assert (len(outline) > 4) if lasso else len(outline) == 4
    assert min(xs) == pytest.approx(10.5, abs=0.3)
    assert max(xs) == pytest.approx(40.5 if lasso else 12.5, abs=0.3)
    assert max(ys) == pytest.approx(40.5 if lasso else 35.5, abs=0.3)
    qtbot.mouseClick(panel, LEFT, pos=at(panel, 20, 20))
    assert len(drawn) == 1  # a slip of the hand draws nothing
    panel.set_tool(None)
    qtbot.mouseClick(panel, LEFT, pos=at(panel, 20, 20))
    assert clicks == [(20, 20)]


def test_the_middle_button_still_pans_with_a_tool_in_the_hand(panel, qtbot):
    panel.set_tool(RegionTool(False))
    before = panel.zoom.view()
    QTest.mousePress(panel, Qt.MouseButton.MiddleButton, Qt.KeyboardModifier.NoModifier, QPoint(100, 100))
    QTest.mouseMove(panel, QPoint(150, 120))
    QTest.mouseRelease(panel, Qt.MouseButton.MiddleButton, Qt.KeyboardModifier.NoModifier, QPoint(150, 120))
    assert panel.zoom.view()[1:] != before[1:]


def test_two_panels_look_alike(panel, show, rgb):
    other = show(RenderPanel(), 400, 300)
    other.set_image(rgb)
    panel.zoom.set_factor(11.0, QPointF(50, 60))
    other.zoom.set_view(*panel.zoom.view())
    assert other.zoom.view() == pytest.approx(panel.zoom.view())
    np.testing.assert_array_equal(pixels(other)[5:-5, 5:-5], pixels(panel)[5:-5, 5:-5])


def test_an_outline_and_a_title_lie_over_the_picture(panel, rgb):
    plain = pixels(panel)
    panel.marks.set_outline([(10, 10), (60, 10), (60, 50), (10, 50)])
    marked = pixels(panel)
    assert (marked != plain).any(-1)[200:220, 40:60].any()  # along the left side
    panel.marks.set_title("run A")
    assert (pixels(panel) != marked).any()
    np.testing.assert_array_equal(panel.grab_image(), rgb)
    panel.marks.set_outline([])
    panel.marks.set_title("")
    np.testing.assert_array_equal(pixels(panel), plain)
