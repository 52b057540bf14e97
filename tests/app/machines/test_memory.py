"""The demo keeps to its memory, at rest and while one goes through its frames."""

from __future__ import annotations

import os
import subprocess
import sys

import torch

from tests.house.source import ROOT

#: Bytes; a PyTorch with CUDA takes more by itself.
BAR = 600_000_000 if torch.version.cuda is None else 1_500_000_000
#: A program of its own: opens the demo, shows all frames and goes back and forth between them, and prints the most memory it ever had
#: and what it has at rest, kB.
STEPS = """
import re
from functools import partial
from pathlib import Path
from degense.app.research.event_loop import rest, run_events, timed, viewer, wait
from degense.app.research.window_start import window_on
from degense.app.session.sample import demo_run

def memory(kind):
    return re.search(rf"{kind}:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]

with window_on(demo_run()) as window:
    wait(lambda: viewer(window).splats is not None and viewer(window).view is not None)
    rest(window)
    run_events(2)
    session = window.session
    for step in [*range(session.frames), *(7 * i % session.frames for i in range(48))]:
        if step != session.frame:
            timed(window, partial(session.go_to, step))
    most = memory("VmHWM")
    rest(window)
    run_events(2)
    print(most, memory("VmRSS"))
"""


def test_the_demo_stays_within_600_mb(tmp_path):
    child = subprocess.run([sys.executable, "-c", STEPS], cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, timeout=300)
    assert child.returncode == 0, child.stderr
    most, at_rest = (1024 * int(number) for number in child.stdout.splitlines()[-1].split())
    assert most <= BAR, f"{most / 1e6:.0f} MB at most"
    assert at_rest <= BAR - 100_000_000, f"{at_rest / 1e6:.0f} MB at rest"
