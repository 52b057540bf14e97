"""Settings survive, and a damaged file costs nothing but the settings."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from degense.app.shell.settings import RECENT_LIMIT, Settings, SettingsFile
from degense.engine.errors import DegenseError
from degense.engine.files import replacing, write_text


def test_settings_come_back(tmp_path):
    path = tmp_path / "deep" / "settings.json"
    SettingsFile(path).update(theme="light", speed=2.0, recent=("a", "b"))
    again = SettingsFile(path)
    assert again.value == Settings(theme="light", speed=2.0, recent=("a", "b"))
    assert again.complaint is None


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"theme": "pink"}',
        '{"speed": "fast"}',
        '{"speed": 1e9}',
        '{"recent": "x"}',
        '{"speed": NaN}',
        '{"trainings": ["x"]}',
        "\xff",
    ],
)
def test_a_damaged_file_is_kept_and_said_once(tmp_path, text):
    path = tmp_path / "settings.json"
    path.write_text(text, encoding="latin-1")
    broken = SettingsFile(path)
    assert broken.value == Settings()
    assert broken.complaint is not None
    assert path.name in broken.complaint
    assert (tmp_path / "settings.json.bad").read_text(encoding="latin-1") == text
    broken.update(theme="light")
    assert SettingsFile(path).complaint is None


def test_settings_of_a_newer_version_are_read(tmp_path):
    path = tmp_path / "settings.json"
    path.write_text(json.dumps({"theme": "light", "telepathy": True}))
    assert SettingsFile(path).value == Settings(theme="light")


def test_recent_files_are_few_new_first_and_single(tmp_path):
    settings = Settings()
    for number in [*range(15), 12]:
        settings = settings.opened(tmp_path / f"clip{number}")
    assert len(settings.recent) == RECENT_LIMIT
    assert [Path(entry).name for entry in settings.recent[:3]] == ["clip12", "clip14", "clip13"]
    assert settings.forgotten(settings.recent[0]).recent == settings.recent[1:]


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "x.txt"
    write_text(path, "old")

    def fail_midway():
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError("midway")

    with pytest.raises(RuntimeError, match="midway"):
        fail_midway()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_in_the_way_is_one_sentence(tmp_path):
    (tmp_path / "x.txt").mkdir()
    with pytest.raises(DegenseError, match=r"x\.txt cannot be written"):
        write_text(tmp_path / "x.txt", "new")
