"""The program as a user starts and stops it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path


def test_it_starts_with_a_run_and_ctrl_c_closes_it(run, own_folders):
    log = Path(os.environ["XDG_STATE_HOME"])
    process = subprocess.Popen([sys.executable, "-m", "degense.app", run], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60

    def remembered() -> bool:
        files = list(Path(os.environ["XDG_CONFIG_HOME"]).rglob("settings.json"))
        return bool(files) and str(run) in files[0].read_text()

    while not (list(log.rglob("degense.log")) and remembered()):  # the run is open
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    assert remembered()
    [text] = [path.read_text() for path in log.rglob("degense.log")]
    assert "ERROR" not in text
    assert "WARNING" not in text


def test_without_a_display_it_says_what_to_do(run):
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")}
    result = subprocess.run([sys.executable, "-m", "degense.app", run], capture_output=True, text=True, env=environment)
    assert result.returncode == 2
    assert result.stderr.startswith("degense: There is no display")


def test_kernels_are_compiled_beside_the_window_once(tmp_path, monkeypatch):
    """The process fills numba's cache, so that a later one compiles nothing, and says that it is done."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    code = (
        "from degense.app import warm_up\n"
        "warm_up.compile_kernels = lambda: None\n"
        "process = warm_up.start()\n"
        "assert process is not None\n"
        "process.terminate(); process.wait()\n"
        "warm_up._done().touch()\n"
        "assert warm_up.start() is None\n"
        "warm_up.__file__ = '/another/installation/degense/app/warm_up.py'\n"  # whose kernels lie beside its own sources
        "assert not warm_up._done().exists()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


#: The window on the screen, as a program of its own, and then what is told of it.
SHOWN = """
import sys
from pathlib import Path
from PySide6.QtWidgets import QApplication
from degense.app.application import FEATURES
from degense.app.research.event_loop import rest, viewer, wait
from degense.app.features.documents.controller import Documents
from degense.app.shell.settings import SettingsFile
from degense.app.shell.shell import Shell

app = QApplication([])
window = Shell(SettingsFile(Path(sys.argv[1])), FEATURES)
window.show()
wait(lambda: window.windowHandle() is not None and window.windowHandle().isExposed())
"""


def told(code: str, *arguments: object) -> str:
    result = subprocess.run([sys.executable, "-c", SHOWN + code, *map(str, arguments)], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


def test_torch_numba_and_vtk_are_not_needed_to_show_the_window(tmp_path):
    heavy = "{'torch', 'numba', 'scipy', 'vtkmodules', 'matplotlib', 'pyvista'}"
    assert told(f"print(*sorted({{name.split('.')[0] for name in sys.modules}} & {heavy}))", tmp_path / "settings.json") == ""


def test_sources_of_modules_do_not_stay_in_memory(run, tmp_path):
    """PySide reads the source of whatever is imported, for which torch alone takes some 40 MB, unless it is told not to."""
    code = (
        "window.service(Documents).open_path(Path(sys.argv[2]))\n"
        "wait(lambda: viewer(window).view is not None)\n"
        "rest(window)\n"
        "import linecache\n"
        "assert 'torch' in sys.modules\n"
        "print(sum(sum(map(len, entry[2])) for name, entry in linecache.cache.items() if len(entry) == 4 and 'torch' in name))\n"
        "window.close()\n"
    )
    assert int(told(code, tmp_path / "settings.json", run)) < 1_000_000
