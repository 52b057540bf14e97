"""Help ▸ User guide."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QTextDocument

from degense.app.features.guide.window import GuideWindow
from tests.app import installed as on


@pytest.fixture
def guide(qtbot, window):
    panel = on.viewer(window).panel
    qtbot.waitUntil(window.isActiveWindow)
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_F1)
    [guide] = window.findChildren(GuideWindow)
    yield guide
    guide.close()


def listed(guide) -> list[str]:
    rows = (guide.list.item(row) for row in range(guide.list.count()))
    return [item.text() for item in rows if not item.isHidden()]


def test_the_key_opens_the_first_page(guide, screenshot):
    assert guide.list.currentItem().text() == "DeGense"
    assert "not a medical device" in guide.view.toPlainText()
    assert len(listed(guide)) == 13
    screenshot(guide, "guide")


def test_a_search_lists_the_pages_that_hold_the_words(qtbot, guide, screenshot):
    qtbot.keyClicks(guide.search, "spz gaussians")
    assert listed(guide) == ["Export"]
    assert {mark.cursor.selectedText().casefold() for mark in guide.view.extraSelections()} == {"spz", "gaussians"}
    screenshot(guide, "guide-search")
    guide.search.setText("xylophone")
    assert listed(guide) == []
    guide.search.clear()
    assert len(listed(guide)) == 13
    guide.search.setText("masks")
    before = guide.list.currentRow()
    qtbot.keyClick(guide.search, Qt.Key.Key_Return)
    assert guide.list.currentRow() != before


def test_links_lead_to_pages_and_pictures_fit(guide):
    guide.view.anchorClicked.emit(QUrl("train.md"))
    assert guide.list.currentItem().text() == "Train"
    picture = guide.view.loadResource(QTextDocument.ResourceType.ImageResource.value, QUrl("images/train.png"))
    assert picture.width() == 680 < guide.view.viewport().width()
    guide.view.anchorClicked.emit(QUrl("https://example.org/nowhere.md"))
    assert guide.list.currentItem().text() == "Train"
