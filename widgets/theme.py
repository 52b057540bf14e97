"""Dark (for operating rooms), light and system themes, and the colours of classes."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QFontDatabase, QPalette
from PySide6.QtWidgets import QApplication

from degense.engine import colour_maps

THEMES = ("dark", "light", "system")

#: Codes of `engine.colour_maps.CLASS_COLOURS`.
CLASS_COLOURS = tuple(f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in colour_maps.CLASS_COLOURS)

#: Colours of the roles: dark, light.
_ROLES = {
    QPalette.ColorRole.Window: ("#1e2126", "#f1f2f4"),
    QPalette.ColorRole.WindowText: ("#d9dce1", "#1d2127"),
    QPalette.ColorRole.Base: ("#343a43", "#ffffff"),
    QPalette.ColorRole.AlternateBase: ("#23272d", "#fafbfc"),
    QPalette.ColorRole.Text: ("#e2e4e8", "#1d2127"),
    QPalette.ColorRole.Button: ("#3b414b", "#e6e8ec"),
    QPalette.ColorRole.ButtonText: ("#e2e4e8", "#1d2127"),
    QPalette.ColorRole.BrightText: ("#ffffff", "#000000"),
    QPalette.ColorRole.ToolTipBase: ("#353a43", "#ffffff"),
    QPalette.ColorRole.ToolTipText: ("#e2e4e8", "#1d2127"),
    QPalette.ColorRole.PlaceholderText: ("#a9b0ba", "#5f6671"),
    QPalette.ColorRole.Highlight: ("#4a9fd4", "#1769a5"),
    QPalette.ColorRole.HighlightedText: ("#0b0e12", "#ffffff"),
    QPalette.ColorRole.Accent: ("#56b4e9", "#1769a5"),
    QPalette.ColorRole.Link: ("#56b4e9", "#1769a5"),
    QPalette.ColorRole.LinkVisited: ("#cc79a7", "#8c3f6f"),
    QPalette.ColorRole.Light: ("#4a505b", "#ffffff"),
    QPalette.ColorRole.Midlight: ("#3d424b", "#f6f7f9"),
    QPalette.ColorRole.Mid: ("#4a505b", "#c3c8d0"),
    QPalette.ColorRole.Dark: ("#121417", "#9aa1ab"),
    QPalette.ColorRole.Shadow: ("#000000", "#5d636d"),
}

#: Text of what cannot be used now: quieter, but it can be read.
_DISABLED = ("#8d949f", "#767d88")

_STYLE = """
QToolTip { color: palette(tool-tip-text); background: palette(tool-tip-base); border: 1px solid palette(mid); padding: 4px; }
QGroupBox { border: 1px solid palette(mid); border-radius: 4px; margin-top: 8px; padding-top: 6px; }
QGroupBox::title { subcontrol-origin: margin; left: 8px; padding: 0 3px; }
QLabel#viewNote { color: palette(window-text); background: palette(window); border-radius: 4px; padding: 2px 6px; }
QFrame#viewBar { background: rgba(0, 0, 0, 150); border-radius: 4px; }
QFrame#viewBar > QWidget { color: white; background: none; }
QLabel#secondary { color: palette(placeholder-text); }
QCheckBox::indicator, QAbstractItemView::indicator, QMenu::indicator { width: 1em; height: 1em; }
QToolButton { padding: 3px; border: 1px solid transparent; border-radius: 4px; }
QToolButton:hover { background: palette(midlight); }
QToolButton:checked { background: palette(mid); border-bottom: 3px solid palette(accent); }
QToolButton#qt_toolbar_ext_button { padding: 0; min-width: 14px; }
QToolButton:focus { border: 1px solid palette(accent); }
QToolButton:checked:focus { border-bottom: 3px solid palette(accent); }
QPushButton:checked { background: palette(mid); border: 1px solid palette(mid); border-bottom: 3px solid palette(accent); }
QTabBar::tab { padding: 4px 10px; border: 1px solid palette(mid); border-bottom: 3px solid palette(mid); }
QTabBar::tab:hover { background: palette(midlight); }
QTabBar::tab:selected { background: palette(mid); border-bottom: 3px solid palette(accent); }
QTabBar::tab:selected:focus { background: palette(highlight); color: palette(highlighted-text); }
QDialogButtonBox { dialogbuttonbox-buttons-have-icons: 0; }
QMainWindow > QTabBar { qproperty-elideMode: ElideNone; }
QDockWidget::close-button, QDockWidget::float-button {
    subcontrol-origin: padding; subcontrol-position: top right; position: absolute; right: 3px;
    width: 1.3em; height: 1.3em; icon-size: 1.2em;
}
QDockWidget::float-button { right: 1.6em; }
QFrame#tour { background: palette(button); border: 1px solid palette(accent); border-radius: 8px; }
QFrame#tourFrame { border: 2px solid palette(accent); border-radius: 4px; }
QFrame#chip { background: palette(button); border: 1px solid palette(mid); border-radius: 6px; }
"""


#: What frames with labels are marked with on dark and on light (after Okabe and Ito, that colour-blind readers tell apart).
LABEL_COLOURS = {
    "labels of the clip": ("#999999", "#767676"),
    "painted": ("#0072b2", "#00508a"),
    "accepted": ("#009e73", "#007f5d"),
    "proposed": ("#56b4e9", "#2f8ccc"),
    "doubtful": ("#e69f00", "#b36b00"),
}
#: What lies behind the 3D view, by the name of the preference: dark in every theme unless another is chosen.
BACKGROUNDS = {"dark": "#0f1114", "black": "#000000", "grey": "#808080", "white": "#ffffff"}


def class_colour(index: int) -> QColor:
    """The colour of a class or prompt; colours repeat after the last."""
    return QColor(CLASS_COLOURS[index % len(CLASS_COLOURS)])


def label_colour(kind: str, palette: QPalette) -> QColor:
    """What a frame with labels of that kind, one of `LABEL_COLOURS`, is marked with."""
    return QColor(LABEL_COLOURS[kind][0 if is_dark(palette) else 1])


def faded(colour: QColor, alpha: int) -> QColor:
    """The colour with an opacity from 0 to 255."""
    return QColor(colour.red(), colour.green(), colour.blue(), alpha)


def is_dark(palette: QPalette) -> bool:
    """True when text is lighter than what it lies on."""
    return palette.color(QPalette.ColorRole.WindowText).lightness() > palette.color(QPalette.ColorRole.Window).lightness()


def frame_background(palette: QPalette) -> QColor:
    """What surrounds frames: darker than the panels."""
    return QColor("#0f1114" if is_dark(palette) else "#e4e6ea")


def error_colour(palette: QPalette) -> QColor:
    """For error messages; never the only sign of an error."""
    return QColor("#ff8f66" if is_dark(palette) else "#b03a00")


def _palette(name: str) -> QPalette:
    palette, theme = QPalette(), ("dark", "light").index(name)
    for role, colours in _ROLES.items():
        palette.setColor(role, QColor(colours[theme]))
    for role in (QPalette.ColorRole.WindowText, QPalette.ColorRole.Text, QPalette.ColorRole.ButtonText, QPalette.ColorRole.HighlightedText):
        palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(_DISABLED[theme]))
    palette.setColor(QPalette.ColorGroup.Disabled, QPalette.ColorRole.Highlight, palette.color(QPalette.ColorRole.Mid))
    return palette


def apply_text_size(app: QApplication, factor: float) -> None:
    """Let all text be so many times as large as the desktop's."""
    font = QFontDatabase.systemFont(QFontDatabase.SystemFont.GeneralFont)
    font.setPointSizeF(factor * font.pointSizeF())
    app.setFont(font)
    app.setStyleSheet(app.styleSheet())  # widgets under a style sheet take another font only with it


def apply_theme(app: QApplication, name: str) -> None:
    """Style the application; may be called again at run time. `system` follows the desktop's light or dark scheme."""
    if name not in THEMES:
        raise ValueError(f"unknown theme {name!r}; there are {', '.join(THEMES)}")
    app.setStyle("Fusion")
    if name == "system":
        name = "dark" if app.styleHints().colorScheme() == Qt.ColorScheme.Dark else "light"
    app.setPalette(_palette(name))
    app.setStyleSheet(_STYLE)
