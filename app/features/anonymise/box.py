"""The box in dialogs of exports that leaves out who is shown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QCheckBox, QWidget

from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.anonymise.cover_drawing import CoverDialog, Rectangle, cover_of
from degense.app.shell.shell import Shell
from degense.widgets import forms
from degense.widgets.keys import PRESS, keep_keys


class Covers(QObject):
    """What is blacked out of the clip that is open, and whether the last export was anonymised: each dialog begins with that."""

    def __init__(self, shell: Shell) -> None:
        super().__init__(shell)
        self.on = False
        self.forget()
        shell.session.opened.connect(self.forget)

    def forget(self) -> None:
        self.rectangles: list[Rectangle] = []
        self.cover: np.ndarray | None = None


class AnonymiseBox(QWidget):
    """Ticked: names of files and where things come from are left out, and burnt-in text is blacked out where that is said."""

    changed = Signal()

    def __init__(self, shell: Shell) -> None:
        super().__init__()
        self._shell, self._covers = shell, shell.service(Covers) or Covers(shell)
        self.check = QCheckBox("leave out names of files and where things come from")
        self.check.setChecked(self._covers.on)
        self.check.toggled.connect(self._toggle)
        keep_keys(self.check, PRESS)
        self.draw = forms.button("Draw…", self._draw, "Black out text that is burnt into the picture: draw rectangles on the frame")
        self.choose = forms.button("Choose…", self._choose, "A picture of the clip's size that is not black where text is burnt in")
        self.nothing = forms.button("Nothing", self._clear, "Black out nothing")
        for made in (self.draw, self.choose, self.nothing):
            made.setAutoDefault(False)
        self.words = forms.label(name="What is blacked out", wrap=False)
        self._row = QWidget()
        forms.row(self.words, 0, self.draw, self.choose, self.nothing, parent=self._row)
        forms.column(self.check, self._row, margin=0, parent=self)
        self._show()

    def value(self) -> Anonymity:
        return Anonymity(self.check.isChecked(), self._covers.cover)

    def _toggle(self, on: bool) -> None:
        self._covers.on = on
        self._show()

    def _draw(self) -> None:
        session = self._shell.session
        clip, scene = session.clip, session.scene
        frame = clip.frame(session.frame) if clip is not None else scene.render_rgb(session.frame) if scene is not None else None
        if frame is not None:
            dialog = CoverDialog(self.window(), frame, self._covers.rectangles)
            dialog.drawn.connect(lambda rectangles: self._drawn(rectangles, (frame.shape[1], frame.shape[0])))
            dialog.open()

    def _drawn(self, rectangles: list[Rectangle], size: tuple[int, int]) -> None:
        self._covers.rectangles, self._covers.cover = rectangles, cover_of(rectangles, size)
        self._show()

    def _choose(self) -> None:
        if (path := self._shell.ask_open("Picture of what is blacked out", "", "Pictures (*.png)")) is not None:
            self._shell.attempt(lambda: self._read(path))

    def _read(self, path: Path) -> None:
        from degense.engine.scene.anonymous import read_cover

        session = self._shell.session
        size = session.scene.clip_size if session.scene is not None else session.clip.size if session.clip is not None else (0, 0)
        self._covers.rectangles, self._covers.cover = [], read_cover(path, size)
        self._show()

    def _clear(self) -> None:
        self._covers.forget()
        self._show()

    def _show(self) -> None:
        cover = self._covers.cover
        self.words.setText("Blacked out: nothing" if cover is None else f"Blacked out: {cover.mean():.1%} of the picture")
        self._row.setEnabled(self.check.isChecked())
        self.nothing.setEnabled(cover is not None)
        self.changed.emit()
