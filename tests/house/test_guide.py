"""What the user guide names is there: its pages, actions with their keys, commands with their options."""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys

import pytest
import yaml

from degense.app.cli.parser import build_parser
from degense.app.features.guide.pages import FOLDER, ORDER, read_guide
from tests.house.source import ROOT

WINDOW = """
import json, sys
from pathlib import Path
from PySide6.QtWidgets import QApplication
from degense.app.shell.settings import SettingsFile
from degense.app.application import FEATURES
from degense.app.shell.shell import Shell

app = QApplication([])
window = Shell(SettingsFile(Path(sys.argv[1])), FEATURES)
print(json.dumps([[*action.menu, action.title, action.shortcuts] for action in window.registry]))
window.close()
"""
PAGES = read_guide()


@pytest.fixture(scope="module")
def actions(tmp_path_factory) -> dict[str, list[str]]:
    """The keys of each action, by its place in the menus: `File ▸ Open run…`. From a process of its own, without a screen."""
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, "-c", WINDOW, str(tmp_path_factory.mktemp("window") / "settings.json")]
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    return {" ▸ ".join(place): keys for *place, keys in json.loads(result.stdout)}


def test_every_page_is_listed_everywhere():
    assert {path.stem for path in FOLDER.glob("*.md")} == set(ORDER)
    sections = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    [listed] = [section["Guide"] for section in sections if "Guide" in section]
    assert [page for entry in listed for page in entry.values()] == [f"guide/{name}.md" for name in ORDER]
    named = {image for page in PAGES for image in re.findall(r"\(images/([\w.]+)\)", page.text)}
    assert named == {path.name for path in (FOLDER / "images").iterdir()}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_actions_named_are_in_the_menus_with_their_keys(page, actions):
    named = re.findall(r"\*\*(\w+ ▸ [^*]+)\*\*(?: \(`([^`]+)`\))?", page.text)
    assert not {place for place, _ in named} - set(actions)
    assert not [(place, key) for place, key in named if key and key not in actions[place]]
    whole = re.findall(r"\*\*(?:File|Edit|View|Inspect|Annotate|Play|Train|Help)\b[^*]*\*\*", page.text)
    assert len(whole) == len(named)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_commands_named_are_those_there_are(page):
    [commands] = [action.choices for action in build_parser()[0]._actions if isinstance(action, argparse._SubParsersAction)]
    for command in re.findall(r"`degense ([^`]+)`", page.text):
        name, *words = command.split()
        if name == "PATH":
            continue
        known = {option for action in commands[name]._actions for option in action.option_strings}
        assert {word for word in words if word.startswith("--")} <= known, command


def test_the_guide_says_enough_in_short_pages():
    assert all(20 < len(page.text.split()) < 500 for page in PAGES)
    assert sum(len(re.findall(r"\*\*\w+ ▸ ", page.text)) for page in PAGES) > 60
