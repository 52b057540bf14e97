"""File ▸ Search archive: a question, and the moments of all runs that answer it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QBuffer, QByteArray, QSize, Qt, Signal
from PySide6.QtGui import QIcon, QImageReader, QPixmap
from PySide6.QtWidgets import QCheckBox, QLineEdit, QTableWidgetItem, QWidget

from degense.app.features.archive.searching import Line, Results
from degense.widgets import forms

#: Pixels of a picture in the list, and the most that one in an index may have.
PICTURE, LARGEST_SIDE = QSize(96, 64), 512
HINT = "A question for all runs, such as “grasper touching gallbladder”"


class SearchDialog(forms.Dialog):
    """Enter searches; a double click, or Enter in the list, opens the run at its moment. `ask_folder` takes a title and where to begin."""

    asked = Signal(object, str, bool)  # (folder, question, whether runs may be opened)
    stopped = Signal()  # the search, where one runs; also when the dialog closes
    chosen = Signal(object)  # (line) to be opened

    def __init__(self, folder: Path, ask_folder: Callable[[str, str], Path | None], parent: QWidget) -> None:
        super().__init__(parent, "archive", "Search archive", 820, 560)
        self._folder, self._ask_folder, self._running = folder, ask_folder, False
        self.lines: tuple[Line, ...] = ()
        self.where = forms.label(str(folder), wrap=False)
        self.question = forms.named(QLineEdit(placeholderText=HINT, clearButtonEnabled=True), "Question")
        self.opening = QCheckBox("Open the runs that the index cannot answer for")
        self.search_button, self.stop_button = forms.button("Search", self.search), forms.button("Stop", self.stop)
        self.note = forms.label(secondary=True, name="What was found")
        self.table = forms.table("Moments of the archive", ["", "Run", "Frames", "Time [s]", "Largest"])
        self.table.setIconSize(PICTURE)
        self.table.verticalHeader().setDefaultSectionSize(PICTURE.height() + 4)
        self.table.cellActivated.connect(lambda row, *_: self._open(row))
        self.table.cellDoubleClicked.connect(lambda row, *_: self._open(row))
        top = forms.row((self.where, 1), forms.button("Another folder…", self._choose))
        asking = forms.row((self.question, 1), self.search_button, self.stop_button)
        forms.column(top, asking, self.opening, (self.table, 1), self.note, self.closing(), margin=9, parent=self)
        self.question.textChanged.connect(lambda text: self._enable())
        self.search_button.setDefault(True)
        self._enable()
        self.question.setFocus()

    def search(self) -> None:
        """Ask anew; the list stays until there are answers."""
        if text := self.question.text().strip():
            self._tell("Looking for new runs", running=True)
            self.asked.emit(self._folder, text, self.opening.isChecked())

    def stop(self) -> None:
        self.stopped.emit()
        self._tell("Stopped; the runs that were looked through stay in the index.")

    def done(self, result: int) -> None:
        if self._running:
            self.stopped.emit()
        super().done(result)

    def show_progress(self, words: str) -> None:
        self.note.setText(words)

    def show_failure(self, message: str) -> None:
        self._tell(message)

    def _tell(self, words: str, running: bool = False) -> None:
        self._running = running
        self.note.setText(words)
        self._enable()

    def _enable(self) -> None:
        self.search_button.setEnabled(bool(self.question.text().strip()))
        self.stop_button.setEnabled(self._running)

    def _choose(self) -> None:
        if (folder := self._ask_folder("Folder with runs", str(self._folder))) is not None:
            self._folder = folder
            self.where.setText(str(folder))

    def show_results(self, results: Results) -> None:
        self.lines, rows = results.lines, []
        for line in self.lines:
            moment, fps = line.moment, line.fps
            seconds = f"{moment.first / fps:.2f}–{moment.last / fps:.2f}"
            rows.append(("", line.run.name, f"{moment.first}–{moment.last}", seconds, f"{moment.area:.1%}"))
        forms.fill(self.table, rows)
        for row, line in enumerate(self.lines):
            item = QTableWidgetItem(QIcon(_pixmap(line.picture)), "")
            item.setToolTip(str(line.run))
            self.table.setItem(row, 0, item)
        self._tell(_in_words(results))

    def _open(self, row: int) -> None:
        self.chosen.emit(self.lines[row])


def _pixmap(jpeg: bytes | None) -> QPixmap:
    """A picture of an index, which may be anybody's; empty where it is none or too large."""
    buffer = QBuffer()
    buffer.setData(QByteArray(jpeg or b""))
    reader = QImageReader(buffer, QByteArray(b"jpeg"))
    reader.setAutoDetectImageFormat(False)
    size = reader.size()
    if not size.isValid() or max(size.width(), size.height()) > LARGEST_SIDE:
        return QPixmap()
    return QPixmap.fromImage(reader.read()).scaled(PICTURE, Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation)


def _in_words(results: Results) -> str:
    """ "12 moments in 3 of 40 runs." and what could not be asked."""
    found = results.found
    words = [f"{found.moments:,} moments in {len(found.hits)} of {found.searched} runs."]
    if found.moments > len(results.lines):
        words.append(f"The first {len(results.lines):,} are listed.")
    if found.unanswered:
        run, why = found.unanswered[0]
        words.append(f"{len(found.unanswered)} runs were not asked, such as {run.path}: {why}")
    if found.broken:
        words.append(f"{len(found.broken)} could not be indexed, such as {found.broken[0].path}: {found.broken[0].error}")
    if results.busy:
        words.append("Another program is indexing this folder; what it has not reached yet is missing.")
    return " ".join(words)
