"""What the start does before its first frame: nothing of it may leave the program other than it was."""

from __future__ import annotations

import subprocess
import sys

import pytest


def _program(code: str) -> str:
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


def test_libraries_are_loaded_without_importing_torch():
    told = _program(
        "import sys\n"
        "from degense.app.start_up import load_libraries_ahead\n"
        "load_libraries_ahead().join()\n"
        "libraries = open('/proc/self/maps').read() if sys.platform == 'linux' else 'libtorch_python.so'\n"
        "print('libtorch_python.so' in libraries, 'torch' in sys.modules)\n"
        "import torch\n"
        "print(torch.ones(3).sum().item())\n"
    )
    assert told.split() == ["True", "False", "3.0"]


@pytest.mark.parametrize("name", ["wave", "no_module_of_this_name"])
def test_garbage_is_looked_for_again_after_an_import(name):
    told = _program(
        "import gc, weakref\n"
        "from degense.app.start_up import import_for_good\n"
        "try:\n"
        f"    import_for_good({name!r})\n"
        "except ImportError:\n"
        "    print('missing')\n"
        "class Ring: pass\n"
        "ring = Ring(); ring.self = ring; seen = weakref.ref(ring); del ring\n"
        "gc.collect()\n"
        "print(gc.isenabled(), seen() is None)\n"
    )
    assert told.split() == (["missing"] if name != "wave" else []) + ["True", "True"]


def test_the_window_loads_no_engine_and_no_format_of_labels():
    """What a start does not need is imported when it is first used."""
    told = _program(
        "import sys\n"
        "from degense.app.cli.main import build_parser\n"
        "build_parser()\n"
        "import degense.app.application\n"
        "heavy = ['torch', 'numba', 'vtkmodules', 'pyvista', 'skimage', 'scipy', 'nibabel', 'highdicom',\n"
        "         'degense.engine.scene', 'degense.engine.annotation.formats.coco']\n"
        "print([name for name in heavy if name in sys.modules])\n"
    )
    assert told == "[]"
