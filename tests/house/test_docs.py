"""What the documents name is there: files they link to, settings, commands and layers."""

from __future__ import annotations

import argparse
import re
from dataclasses import fields

import pytest

from degense.app.cli.parser import build_parser
from degense.engine.layers import LAYERS
from degense.engine.training import TrainConfig
from tests.house.source import ROOT

PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
SETTINGS = {field.name for field in fields(TrainConfig)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    assert not [link for link in links if "://" not in link and not (page.parent / link).exists()]


def test_the_switches_named_are_settings():
    text = (ROOT / "docs" / "differences-from-the-paper.md").read_text(encoding="utf-8")
    named = {*re.findall(r"`(\w+)=\w+`", text)} - {"name"}
    assert len(named) > 8
    assert not named - SETTINGS


def test_the_commands_and_options_named_are_those_there_are():
    [commands] = [action.choices for action in build_parser()[0]._actions if isinstance(action, argparse._SubParsersAction)]
    rows = re.findall(r"^\| `degense (\w+)([^`]*)` \|(.*)\|$", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert {name for name, *_ in rows} == {*commands} - {"open"}
    for name, usage, text in rows:
        known = {option for action in commands[name]._actions for option in action.option_strings}
        assert {*re.findall(r"--[a-z][a-z-]+", usage + text)} <= known, name


def test_the_layers_named_are_those_there_are():
    [line] = re.findall(r"^Layers: (.*?)\.", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", line)) == set(LAYERS)


def test_a_cell_of_a_table_holds_one_number():
    """In the README's tables of measurements, whose columns of numbers have a unit or a name without a number."""
    tables = re.findall(r"(?:^\|.*\n)+", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    wrong = [
        cell
        for table in tables
        for row in table.splitlines()[2:]
        for cell in row.strip("|").split("|")[1:]
        if "`" not in cell and re.fullmatch(r"[\d.,\s;–±()%→]+", cell) and len(re.findall(r"[\d.,]*\d", cell)) > 1
    ]
    assert not wrong


def test_the_index_lists_every_decision_by_its_title():
    index = (ROOT / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    for page in (ROOT / "docs" / "decisions").glob("0*.md"):
        number, title = page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ").split(". ", 1)
        assert f"| [{number}]({page.name}) | {title} |" in index


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_paths_named_exist(page):
    """In code marks; what a decision says was measured or tried before keeps the words of its time, but not in code marks."""
    paths = re.findall(r"`((?:app|engine|widgets|tests|docs|scripts)/[\w./-]+)`", page.read_text(encoding="utf-8"))
    assert not [path for path in paths if not (ROOT / path).exists()]
