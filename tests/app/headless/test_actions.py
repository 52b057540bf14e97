"""The table of actions, without a window."""

from __future__ import annotations

import pytest

from degense.app.shell.actions import Action, ActionRegistry
from degense.engine.errors import DegenseError


@pytest.fixture
def registry() -> ActionRegistry:
    registry = ActionRegistry()
    registry.add(
        Action("file.open", "Open clip…", lambda: None, ("File",), ("Ctrl+O",), help="folder"),
        Action("view.depth", "Depth", lambda: None, ("View", "Layer"), ("2",)),
        Action("view.deeper", "Go deeper", lambda: None, ("View",), enabled=lambda: False),
        Action("edit.redo", "Redo", lambda: None, ("Edit",), ("Ctrl+Y", "Ctrl+Shift+Z")),
    )
    return registry


@pytest.mark.parametrize(
    "action", [Action("file.open", "Again", lambda: None), Action("x", "", lambda: None), Action("x", "X", lambda: None, shortcuts=("2",))]
)
def test_ids_and_keys_are_unique_and_titles_there(registry, action):
    with pytest.raises(ValueError, match=r"twice|already"):
        registry.add(action)


@pytest.mark.parametrize(
    ("typed", "action"), [("video", "export.movie"), ("film", "export.movie"), ("vid", "export.movie"), ("exit", "file.quit")]
)
def test_search_knows_words_that_mean_the_same(typed, action):
    registry = ActionRegistry()
    registry.add(Action("file.quit", "Quit", print, ("File",)), Action("export.movie", "Movie of the layer…", print, ("File",)))
    assert [found.id for found in registry.search(typed)] == [action]


def test_titles_come_before_synonyms_and_these_before_help_texts():
    registry = ActionRegistry()
    registry.add(
        Action("labels", "Masks or annotations…", print, ("File",), help="tracks for video"),
        Action("open", "Open video…", print, ("File",), help="clip from a movie file"),
        Action("flight", "Fly along", print, ("View",), help="movie"),
        Action("movie", "Movie…", print, ("File",)),
    )
    assert [found.id for found in registry.search("video")] == ["open", "movie", "labels", "flight"]
    assert [found.id for found in registry.search("film")] == ["movie", "open", "labels", "flight"]
    assert [found.id for found in registry.search("movie")] == ["movie", "open", "flight", "labels"]


def test_search_ranks_word_starts_and_leaves_out_what_cannot_be_done(registry):
    assert [action.id for action in registry.search("de")] == ["view.depth", "file.open"]
    assert [action.id for action in registry.search("FOLDER")] == ["file.open"]
    assert [action.id for action in registry.search("file clip")] == ["file.open"]
    assert registry.search("nothing like it") == []
    assert len(registry.search("")) == 3


def test_what_is_disabled_does_not_run(registry):
    with pytest.raises(DegenseError, match="Go deeper"):
        registry.run("view.deeper")


def test_cheat_sheet_groups_by_menu(registry):
    sheet = registry.cheat_sheet()
    assert sheet["Edit"] == [("Ctrl+Y or Ctrl+Shift+Z", "Redo")]
    assert list(sheet) == ["File", "View", "Edit"]
