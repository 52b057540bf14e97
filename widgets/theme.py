"""Dark (for operating rooms), light and system themes, and the colours of classes."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication

from degense.engine import colour_maps

THEMES = ("dark", "light", "system")

#: Codes of `engine.colour_maps.CLASS_COLOURS`.
CLASS_COLOURS = tuple(f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in colour_maps.CLASS_COLOURS)

_ROLES = {
    "dark": {
        QPalette.ColorRole.Window: "#1e2126",
        QPalette.ColorRole.WindowText: "#d9dce1",
        QPalette.ColorRole.Base: "#343a43",
        QPalette.ColorRole.AlternateBase: "#23272d",
        QPalette.ColorRole.Text: "#e2e4e8",
        QPalette.ColorRole.Button: "#3b414b",
        QPalette.ColorRole.ButtonText: "#e2e4e8",
        QPalette.ColorRole.BrightText: "#ffffff",
        QPalette.ColorRole.ToolTipBase: "#353a43",
        QPalette.ColorRole.ToolTipText: "#e2e4e8",
        QPalette.ColorRole.PlaceholderText: "#8b929c",
        QPalette.ColorRole.Highlight: "#2f7fb8",
        QPalette.ColorRole.HighlightedText: "#ffffff",
        QPalette.ColorRole.Accent: "#56b4e9",
        QPalette.ColorRole.Link: "#56b4e9",
        QPalette.ColorRole.LinkVisited: "#cc79a7",
        QPalette.ColorRole.Light: "#4a505b",
        QPalette.ColorRole.Midlight: "#3d424b",
        QPalette.ColorRole.Mid: "#4a505b",
        QPalette.ColorRole.Dark: "#121417",
        QPalette.ColorRole.Shadow: "#000000",
    },
    "light": {
        QPalette.ColorRole.Window: "#f1f2f4",
        QPalette.ColorRole.WindowText: "#1d2127",
        QPalette.ColorRole.Base: "#ffffff",
        QPalette.ColorRole.AlternateBase: "#fafbfc",
        QPalette.ColorRole.Text: "#1d2127",
        QPalette.ColorRole.Button: "#e6e8ec",
        QPalette.ColorRole.ButtonText: "#1d2127",
        QPalette.ColorRole.BrightText: "#000000",
        QPalette.ColorRole.ToolTipBase: "#ffffff",
        QPalette.ColorRole.ToolTipText: "#1d2127",
        QPalette.ColorRole.PlaceholderText: "#686f7a",
        QPalette.ColorRole.Highlight: "#1769a5",
        QPalette.ColorRole.HighlightedText: "#ffffff",
        QPalette.ColorRole.Accent: "#1769a5",
        QPalette.ColorRole.Link: "#1769a5",
        QPalette.ColorRole.LinkVisited: "#8c3f6f",
        QPalette.ColorRole.Light: "#ffffff",
        QPalette.ColorRole.Midlight: "#f6f7f9",
        QPalette.ColorRole.Mid: "#c3c8d0",
        QPalette.ColorRole.Dark: "#9aa1ab",
        QPalette.ColorRole.Shadow: "#5d636d",
    },
}

_DISABLED = {"dark": "#686f7a", "light": "#9aa1ab"}

_STYLE = """
QToolTip { color: palette(tool-tip-text); background: palette(tool-tip-base); border: 1px solid palette(mid); padding: 4px; }
QGroupBox { border: 1px solid palette(mid); border-radius: 4px; margin-top: 8px; padding-top: 6px; }
QGroupBox::title { subcontrol-origin: margin; left: 8px; padding: 0 3px; }
QLabel#viewNote { color: palette(window-text); background: palette(window); border-radius: 4px; padding: 2px 6px; }
QLabel#secondary { color: palette(placeholder-text); }
QToolButton { padding: 3px; border: 1px solid transparent; border-radius: 4px; }
QToolButton:hover { background: palette(midlight); }
QToolButton:checked { background: palette(mid); }
QToolButton:focus { border: 1px solid palette(accent); }
QMainWindow > QTabBar { qproperty-elideMode: ElideNone; }
QFrame#chip { background: palette(button); border: 1px solid palette(mid); border-radius: 6px; }
"""


def class_colour(index: int) -> QColor:
    """The colour of a class or prompt; colours repeat after the last."""
    return QColor(CLASS_COLOURS[index % len(CLASS_COLOURS)])


def is_dark(palette: QPalette) -> bool:
    """True when text is lighter than what it lies on."""
    return palette.color(QPalette.ColorRole.WindowText).lightness() > palette.color(QPalette.ColorRole.Window).lightness()


def frame_background(palette: QPalette) -> QColor:
    """What surrounds frames: darker than the panels."""
    return QColor("#0f1114" if is_dark(palette) else "#d6d9de")


def error_colour(palette: QPalette) -> QColor:
    """For error messages; never the only sign of an error."""
    return QColor("#ff8f66" if is_dark(palette) else "#b03a00")


def _palette(name: str) -> QPalette:
    palette = QPalette()
    for role, colour in _ROLES[name].items():
        palette.setColor(role, QColor(colour))
    for role in (QPalette.ColorRole.WindowText, QPalette.ColorRole.Text, QPalette.ColorRole.ButtonText, QPalette.ColorRole.HighlightedText):
        palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(_DISABLED[name]))
    palette.setColor(QPalette.ColorGroup.Disabled, QPalette.ColorRole.Highlight, QColor(_ROLES[name][QPalette.ColorRole.Mid]))
    return palette


def apply_theme(app: QApplication, name: str) -> None:
    """Style the application; may be called again at run time. `system` follows the desktop's light or dark scheme."""
    if name not in THEMES:
        raise ValueError(f"unknown theme {name!r}; there are {', '.join(THEMES)}")
    app.setStyle("Fusion")
    if name == "system":
        name = "dark" if app.styleHints().colorScheme() == Qt.ColorScheme.Dark else "light"
    app.setPalette(_palette(name))
    app.setStyleSheet(_STYLE)
