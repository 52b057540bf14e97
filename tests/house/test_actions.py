"""The actions of all areas fit together: the table can be filled, so no two want the same key and each has a title and a place."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.house.source import ROOT

WINDOW = """
import sys
from pathlib import Path
from PySide6.QtWidgets import QApplication
from degense.app.shell.settings import SettingsFile
from degense.app.application import FEATURES
from degense.app.shell.shell import Shell

app = QApplication([])
window = Shell(SettingsFile(Path(sys.argv[1])), FEATURES)
print(len(list(window.registry)))
window.close()
"""


def test_the_table_of_actions_can_be_filled(tmp_path):
    """In a process of its own, without a screen: cheap enough to run before every merge."""
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, "-c", WINDOW, str(tmp_path / "settings.json")]
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr.splitlines()[-1]
    assert int(result.stdout) > 50
