"""What a reader of the project may rely on: formatted, typed, with no path of anybody's machine."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.house.source import ROOT, texts

#: A folder that exists on one machine only: a home, a scratch folder, a mounted drive. Examples in documents use ~ or relative paths.
MACHINE_PATH = re.compile(r"(?<![\w.~/])/(?:home|Users|root|work|workspace|mnt|data|tmp|var/folders)/\w[\w./-]*|\b[A-Z]:\\\\?Users\b")


def test_no_path_of_a_machine():
    found = [
        f"{path.relative_to(ROOT)}:{number} {match.group()}"
        for path in texts()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        for match in MACHINE_PATH.finditer(line)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("open('/" + "home/ada/clip')", True),
        ("/" + "tmp/x.png", True),
        ("C:" + "\\Users\\ada", True),
        ("a/tmp/b", False),
        ("~/" + "work/run", False),
        ("/dev/null", False),
    ],
)
def test_the_rule_for_paths_itself(text, found):
    assert bool(MACHINE_PATH.search(text)) is found


@pytest.mark.parametrize(
    "command",
    [("ruff", "check", "--no-cache", "."), ("ruff", "format", "--check", "--no-cache", ".")],
    ids=["lint", "format"],
)
def test_checkers_are_content(command):
    result = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    print(result.stdout, result.stderr)  # shown once, where it fails; in the assertion it would fill the summary as well
    assert result.returncode == 0, f"{' '.join(command)} found faults, printed above"


def test_the_types_fit(tmp_path):
    """mypy reads no import hook, by which an editable install finds `degense.*`: it is shown the folders where a wheel has them."""
    (tmp_path / "degense").mkdir()
    for folder in ("app", "engine", "widgets"):
        (tmp_path / "degense" / folder).symlink_to(ROOT / folder)
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    print(result.stdout, result.stderr)
    assert result.returncode == 0, "mypy found faults, printed above"
