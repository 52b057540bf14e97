"""Task: find a moment in an archive, and open its run there."""

from __future__ import annotations

import shutil

from PySide6.QtCore import Qt

from degense.app.features.archive.dialog import SearchDialog
from degense.engine.archive.index_file import INDEX, open_index
from tests.app import installed as on


def searched(qtbot, window, text: str) -> SearchDialog:
    """The dialog, when it has its answers."""
    dialog = window.findChild(SearchDialog)
    dialog.question.setText(text)
    qtbot.mouseClick(dialog.search_button, Qt.MouseButton.LeftButton)
    assert dialog.stop_button.isEnabled()
    qtbot.waitUntil(lambda: not dialog.stop_button.isEnabled())
    return dialog


def test_a_moment_is_found_and_its_run_opened_there(qtbot, window, run, tmp_path, idle, screenshot):
    folder = tmp_path / "archive"
    for name in ("first", "second"):
        shutil.copytree(run, folder / name)
    (folder / "broken").mkdir()
    (folder / "broken" / "run.json").write_text("{half")
    window.settings.update(last_folder=str(folder))
    window.registry.run("file.search")
    dialog = searched(qtbot, window, "grasper at its largest")
    at = dialog.lines[0].moment.first
    assert [(line.run.name, line.moment.first) for line in dialog.lines] == [("first", at), ("second", at)]
    assert not dialog.table.item(0, 0).icon().isNull()
    assert "2 moments in 2 of 2 runs." in dialog.note.text()
    assert "1 could not be indexed, such as broken" in dialog.note.text()
    screenshot(window, "archive")
    dialog.table.cellDoubleClicked.emit(1, 1)
    idle()
    assert (window.session.scene.run.path, window.session.frame) == (folder / "second", at)
    window.session.go_to(0 if at else 1)
    dialog.table.cellDoubleClicked.emit(1, 1)  # the run is open already
    assert window.session.frame == at
    searched(qtbot, window, "xylophone")
    assert "'xylophone' is not in the vocabulary" in dialog.note.text()
    dialog.close()


def test_indexing_is_stopped_and_keeps_what_it_has(qtbot, window, run, tmp_path, idle):
    folder = tmp_path / "archive"
    for name in ("a", "b"):
        shutil.copytree(run, folder / name)
    on.archive(window).folder = folder
    window.registry.run("file.search")
    dialog = window.findChild(SearchDialog)
    dialog.question.setText("liver")
    dialog.search()
    qtbot.waitUntil(lambda: "run 2 of 2" in dialog.note.text())
    dialog.stop()
    idle()
    assert "Stopped" in dialog.note.text()
    with open_index(folder / INDEX) as index:
        assert [str(known.path) for known in index.runs()] == ["a"]
    dialog.search()
    dialog.close()  # which stops it
    idle()
    assert not window.worker.busy("archive")
