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
    while not list(log.rglob("degense.log")) or not list(Path(os.environ["XDG_CONFIG_HOME"]).rglob("settings.json")):
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    [settings] = Path(os.environ["XDG_CONFIG_HOME"]).rglob("settings.json")
    assert str(run) in settings.read_text()
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
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_torch_numba_and_vtk_are_not_needed_to_show_the_window():
    code = (
        "import sys; import degense.app.application\n"
        "print(*sorted({name.split('.')[0] for name in sys.modules} & {'torch', 'numba', 'vtkmodules', 'matplotlib', 'pyvista'}))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert result.stdout.strip() == ""
