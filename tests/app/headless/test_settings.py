"""Settings survive, and a damaged file costs nothing but the settings."""

from __future__ import annotations

import json
import subprocess
import sys
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


def test_two_windows_lose_no_settings_of_each_other(tmp_path):
    """Changes by turns, and eight processes at once."""
    path = tmp_path / "settings.json"
    one, other = SettingsFile(path), SettingsFile(path)
    one.update(theme="light")
    other.update(speed=2.0)
    one.change(lambda settings: settings.opened(tmp_path / "a"))
    other.change(lambda settings: settings.opened(tmp_path / "b"))
    assert one.value.speed == 2.0
    last = SettingsFile(path).value
    assert (last.theme, last.speed, [Path(entry).name for entry in last.recent]) == ("light", 2.0, ["b", "a"])
    program = (
        "import sys; from pathlib import Path\n"
        "from degense.app.shell import settings; from degense.app.shell.settings import SettingsFile\n"
        "settings.PATIENCE = 300.0\n"  # whether a change is lost to another, not how long a busy machine takes
        "file = SettingsFile(Path(sys.argv[1]))\n"
        "for step in range(20):\n"
        "    file.change(lambda s: type(s)(**{**vars(s), 'training': {**s.training, f'{sys.argv[2]}-{step}': 1}}))"
    )
    started = [subprocess.Popen([sys.executable, "-c", program, str(path), str(number)]) for number in range(8)]
    assert [process.wait() for process in started] == [0] * 8
    assert len(SettingsFile(path).value.training) == 160


def test_settings_that_cannot_be_written_last_as_long_as_the_window(tmp_path, caplog):
    (tmp_path / "file").write_text("in the way of the folder")
    settings = SettingsFile(tmp_path / "file" / "settings.json")
    settings.update(theme="light")
    assert settings.value.theme == "light"
    assert "not kept" in caplog.text


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
