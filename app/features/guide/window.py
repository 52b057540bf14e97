"""The user guide in a window: pages at the left, a search above them, the page at the right."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QImage, QTextCursor, QTextDocument, QTextTable
from PySide6.QtWidgets import QDialogButtonBox, QLineEdit, QListWidget, QListWidgetItem, QSplitter, QTextBrowser, QTextEdit, QWidget

from degense.app.features.guide.pages import FOLDER, Page
from degense.widgets import forms

PICTURE_WIDTH = 680  # of pictures that are wider, pixels


class PageView(QTextBrowser):
    """Shows a page; a link to another page is followed by the window, and nothing is fetched from elsewhere."""

    def __init__(self) -> None:
        super().__init__(openLinks=False)
        self.setAccessibleName("Page")
        self.document().setDocumentMargin(16)

    def show_page(self, page: Page) -> None:
        self.document().setMarkdown(page.text, QTextDocument.MarkdownFeature.MarkdownDialectGitHub)
        self._space_out()
        self.moveCursor(QTextCursor.MoveOperation.Start)

    def mark(self, words: Sequence[str]) -> None:
        """Highlight where the words stand, and show the first place."""
        marks = []
        for word in words:
            found = self.document().find(word)
            while not found.isNull():
                mark = QTextEdit.ExtraSelection()
                mark.cursor = found
                mark.format.setBackground(self.palette().highlight())
                mark.format.setForeground(self.palette().highlightedText())
                marks.append(mark)
                found = self.document().find(word, found)
        self.setExtraSelections(marks)
        if marks:
            first = QTextCursor(self.document())
            first.setPosition(min(mark.cursor.selectionStart() for mark in marks))
            self.setTextCursor(first)
            self.ensureCursorVisible()

    def loadResource(self, kind: int, name: QUrl | str) -> object:
        """Pictures of the guide, and nothing else."""
        picture = QImage(str(FOLDER / "images" / QUrl(name).fileName()))
        if picture.width() > PICTURE_WIDTH:
            return picture.scaledToWidth(PICTURE_WIDTH, Qt.TransformationMode.SmoothTransformation)
        return picture

    def _space_out(self) -> None:
        """Give the cells of tables some room."""
        for frame in self.document().rootFrame().childFrames():
            if isinstance(frame, QTextTable):
                form = frame.format()
                form.setCellPadding(5)
                form.setBorderCollapse(True)
                form.setBorderBrush(self.palette().mid())
                frame.setFormat(form)


class GuideWindow(forms.Dialog):
    """The guide; Enter in the search goes to the next page that holds what is typed."""

    def __init__(self, pages: Sequence[Page], parent: QWidget) -> None:
        super().__init__(parent, "guide", "User guide", 980, 720)
        self._pages = pages
        self.search = forms.named(QLineEdit(clearButtonEnabled=True), "Search the guide")
        self.search.setPlaceholderText("Search")
        self.list = forms.named(QListWidget(), "Pages of the guide")
        self.view = PageView()
        self._nothing = forms.label("No page holds all these words.", secondary=True)
        self._nothing.hide()
        side = QWidget()
        forms.column(self.search, self._nothing, (self.list, 1), margin=0, parent=side)
        both = QSplitter(Qt.Orientation.Horizontal, childrenCollapsible=False)
        both.addWidget(side)
        both.addWidget(self.view)
        both.setStretchFactor(1, 1)
        both.setSizes([210, 770])
        closing = self.closing()
        closing.button(QDialogButtonBox.StandardButton.Close).setAutoDefault(False)  # Enter belongs to the search
        forms.column((both, 1), closing, margin=11, parent=self)
        for page in pages:
            QListWidgetItem(page.title, self.list)
        self.list.currentRowChanged.connect(self._show)
        self.search.textChanged.connect(self._search)
        self.search.returnPressed.connect(self._next)
        self.view.anchorClicked.connect(self._follow)
        self.list.setCurrentRow(0)
        self.search.setFocus()

    def open_page(self, name: str) -> None:
        """Show the page of that name; nothing happens when there is none."""
        for row, page in enumerate(self._pages):
            if page.name == name:
                self.search.clear()
                self.list.setCurrentRow(row)

    def _follow(self, link: QUrl) -> None:
        self.open_page(link.fileName().removesuffix(".md"))

    def _show(self, row: int) -> None:
        if row >= 0:
            self.view.show_page(self._pages[row])
            self.view.mark(self.search.text().split())

    def _search(self, words: str) -> None:
        """List only the pages that hold the words, and show the first of them."""
        rows = [row for row, page in enumerate(self._pages) if page.holds(words)]
        for row in range(len(self._pages)):
            self.list.item(row).setHidden(row not in rows)
        self._nothing.setVisible(not rows)
        if rows and self.list.currentRow() not in rows:
            self.list.setCurrentRow(rows[0])
        else:
            self.view.mark(words.split())

    def _next(self) -> None:
        """The next listed page, round and round."""
        rows = [row for row in range(self.list.count()) if not self.list.item(row).isHidden()]
        if rows:
            self.list.setCurrentRow(next((row for row in rows if row > self.list.currentRow()), rows[0]))
