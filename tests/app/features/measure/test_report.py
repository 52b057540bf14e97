"""Task: one file for colleagues: pictures, curves, tables, and where they come from."""

from __future__ import annotations

import base64
import io
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from degense.app.features.anonymise.file_dialog import FileDialog
from degense.widgets.theme import class_colour
from tests.app import installed as on

BOTH = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier


class Page(HTMLParser):
    """The words and the pictures of a page, and everything that it would load."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words, self.pictures, self.loads = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs) -> None:
        for key, value in attrs:
            if key in ("src", "href"):
                (self.pictures if value.startswith("data:image/png;base64,") else self.loads).append(value)

    def handle_data(self, data) -> None:
        self.words.append(data)

    def picture(self, index: int) -> np.ndarray:
        return np.array(Image.open(io.BytesIO(base64.b64decode(self.pictures[index].split(",")[1]))))


@pytest.fixture
def told(opened, idle):
    """A run with a prompt, two measures, and two events of which one has a hostile note; frame 4 is shown."""
    opened.session.go_to(4)
    on.measuring(opened).state.add("distance", 4, ((30.0, 30.0), (60.0, 45.0)))
    on.measuring(opened).state.add("area", 4, ((40.0, 20.0), (65.0, 20.0), (65.0, 45.0)))
    on.events(opened).state.put(4, "the tool arrives")
    on.events(opened).state.put(7, "<script>alert(1)</script>")
    idle()
    return opened


def export(window, idle, path) -> FileDialog:
    panel = on.viewer(window).panel
    panel.setFocus()
    QTest.keyClick(panel, Qt.Key.Key_R, BOTH)
    dialog = window.findChild(FileDialog)
    dialog.path.line.selectAll()
    QTest.keyClicks(dialog.path.line, str(path))
    QTest.keyClick(dialog, Qt.Key.Key_Return)
    idle()
    return dialog


def test_a_page_with_everything_in_it(told, idle, tmp_path):
    export(told, idle, tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.loads == []
    assert "<script" not in text
    scene = told.session.scene
    assert len(page.pictures) == 2 + 3  # two frames, three curves
    picture, drawn = page.picture(1).astype(int), scene.render_rgb(7).astype(int)
    scale = picture.shape[1] // drawn.shape[1]
    apart = np.abs(picture - drawn.repeat(scale, 0).repeat(scale, 1)).max(-1) > 8
    assert 0.005 < apart.mean() < 0.3  # the measures; all else is the frame
    ends = on.measuring(told).found[on.measuring(told).state.measures[0]].pixels[:, 7] * scale
    x, y = (ends[0] + 0.2 * (ends[1] - ends[0])).astype(int)
    assert np.abs(picture[y, x] - class_colour(0).getRgb()[:3]).max() < 40
    words = " ".join(page.words)
    distance, area, volume = on.measuring(told).quantities()
    for item in (distance, area, volume):
        assert f"{item.values[-1]:.4g} {item.unit}" in words
    clip = told.session.clip
    pixels = sum(int((clip.labels(frame) == 1).sum()) for frame in range(10))
    for expected in ("the tool arrives", "alert(1)", "0.16 s", f"{pixels:,}", scene.name, "not a medical device", "teacher"):
        assert expected in words, expected


def test_a_printed_report(told, idle, tmp_path):
    export(told, idle, tmp_path / "a.pdf")
    data = (tmp_path / "a.pdf").read_bytes()
    assert data.startswith(b"%PDF-")
    assert data.rstrip().endswith(b"%%EOF")
    assert len(re.findall(rb"/Type\s*/Page\b", data)) >= 2
    assert len(re.findall(rb"/Subtype\s*/Image", data)) >= 5
    assert list(tmp_path.glob(".a*")) == []


def test_of_a_clip_without_a_run(window, tiny_clip, idle, tmp_path):
    on.documents(window).open_path(tiny_clip)
    idle()
    on.reporter(window).export(tmp_path / "a.html")
    idle()
    page = Page((tmp_path / "a.html").read_text(encoding="utf-8"))
    assert np.array_equal(page.picture(0), window.session.clip.frame(0))
    assert "Measures" not in page.words


def test_other_suffixes_are_refused(told, idle, tmp_path):
    dialog = export(told, idle, tmp_path / "a.docx")
    assert dialog.complaint.text() == "a.docx must end in .html or .pdf."
    assert dialog.isVisible()
    dialog.reject()
    assert not (tmp_path / "a.docx").exists()
