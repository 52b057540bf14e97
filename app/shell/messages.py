"""Dialogs that say something. They do not block: the window goes on living behind them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from PySide6.QtCore import Qt
from PySide6.QtGui import QFontDatabase
from PySide6.QtWidgets import (
    QAbstractButton,
    QDialog,
    QMessageBox,
    QPlainTextEdit,
    QTextBrowser,
    QWidget,
)

from degense.widgets import forms

log = logging.getLogger(__name__)

#: Width of a column of shortcuts, characters.
COLUMN = 42

ABOUT = """<h3>DeGense {version}</h3>
<p>Reconstructs a surgical video as a 4D Gaussian scene, answers prompts in words, and shows how tissue moved.</p>
<p><b>For research, not a medical device.</b> Nothing shown here may guide the treatment of a patient.</p>"""


def show_error(parent: QWidget, text: str) -> None:
    """One sentence about what went wrong. While such a dialog is open, a further error replaces its text: no heap of dialogs."""
    log.error(text)
    box = parent.findChild(QMessageBox, "error")
    if box is None:
        box = QMessageBox(QMessageBox.Icon.Warning, "DeGense", "", QMessageBox.StandardButton.Ok, parent)
        box.setObjectName("error")
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        box.setTextFormat(Qt.TextFormat.PlainText)
    box.setText(text)
    box.open()


@dataclass(frozen=True)
class Choice:
    """A button of `ask`: what it says, and what it does; `escape` is what closing the dialog means, `default` what Enter means."""

    label: str
    act: Callable[[], object] = lambda: None
    default: bool = False
    escape: bool = False


def ask(parent: QWidget, name: str, text: str, choices: Sequence[Choice], details: str, icon: QMessageBox.Icon) -> None:
    """Ask a question that does not block the window; `name` is the dialog's object name. One of the choices is the escape."""
    box = QMessageBox(icon, "DeGense", text, QMessageBox.StandardButton.NoButton, parent)
    box.setObjectName(name)
    box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    box.setInformativeText(details)
    escape = next(choice for choice in choices if choice.escape)
    buttons: dict[QAbstractButton, Choice] = {}
    for choice in choices:
        role = QMessageBox.ButtonRole.RejectRole if choice.escape else QMessageBox.ButtonRole.AcceptRole
        button = box.addButton(choice.label, role)
        buttons[button] = choice
        if choice.default:
            box.setDefaultButton(button)
        if choice.escape:
            box.setEscapeButton(button)
    box.finished.connect(lambda: buttons.get(box.clickedButton(), escape).act())
    box.open()


def show_about(parent: QWidget) -> None:
    from importlib.metadata import version

    box = QMessageBox(
        QMessageBox.Icon.NoIcon, "About DeGense", ABOUT.format(version=version("degense")), QMessageBox.StandardButton.Ok, parent
    )
    box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    box.open()


def show_text(parent: QWidget, title: str, text: str) -> QDialog:
    """A window with text in fixed columns."""
    view = forms.named(QPlainTextEdit(text, readOnly=True, lineWrapMode=QPlainTextEdit.LineWrapMode.NoWrap), title)
    view.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
    return _dialog(parent, title, view, 760, 480)


def show_page(parent: QWidget, title: str, html: str) -> QDialog:
    """A window with a page to read."""
    view = forms.named(QTextBrowser(), title)
    view.setHtml(html)
    view.document().setDocumentMargin(14)
    return _dialog(parent, title, view, 720, 640)


def show_cheat_sheet(parent: QWidget, sheet: dict[str, list[tuple[str, str]]]) -> QDialog:
    """All shortcuts, by menu, in as many columns as there is room for."""
    page = forms.named(QTextBrowser(), "Shortcuts")  # whose lines break rather than be cut off
    dialog = _dialog(parent, "Shortcuts", page, 1000, 680)
    count = min(3, dialog.width() // (COLUMN * dialog.fontMetrics().averageCharWidth()))
    page.setHtml(_in_columns(sheet, max(1, count)))
    return dialog


def _in_columns(sheet: dict[str, list[tuple[str, str]]], number: int) -> str:
    columns: list[list[str]] = [[] for _ in range(number)]
    per_column, count = sum(len(rows) + 2 for rows in sheet.values()) / len(columns), 0
    for menu, rows in sheet.items():
        keys = "".join(f"<tr><td style='padding: 2px 18px 2px 0'><b>{_arrows(key)}</b></td><td>{title}</td></tr>" for key, title in rows)
        place = min(int((count + (len(rows) + 2) / 2) / per_column), len(columns) - 1)
        columns[place].append(f"<h4 style='margin: 8px 0 2px 0'>{menu}</h4><table>{keys}</table>")
        count += len(rows) + 2
    share = 100 // len(columns)
    cells = "".join(f"<td width='{share}%' style='padding-right: 18px'>{''.join(blocks)}</td>" for blocks in columns)
    return f"<table width='100%'><tr>{cells}</tr></table>"


def _arrows(key: str) -> str:
    for name, sign in (("Left", "←"), ("Right", "→"), ("Up", "↑"), ("Down", "↓")):
        key = key.replace(name, sign)
    return key


def _dialog(parent: QWidget, title: str, content: QWidget, width: int, height: int) -> QDialog:
    dialog = forms.Dialog(parent, "", title, width, height)
    forms.column(content, dialog.closing(), margin=11, parent=dialog)
    dialog.show()
    return dialog
