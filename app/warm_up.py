"""Compiling numba's kernels before they are needed: a process of its own, once after installing, beside the window.

The kernels are kept in numba's cache on disk. Compiled in the window's own process, when the first frame or prompt needs them, they would
take a minute on a busy machine, and Python's lock with them.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import platformdirs


def _done() -> Path:
    """The file that says that these versions of numba and of the program have compiled here: numba keeps kernels beside their sources."""
    from importlib.metadata import version

    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("degense", appauthor=False))
    place = hashlib.sha256(os.fsencode(Path(__file__).resolve().parent)).hexdigest()[:12]
    return folder / f"kernels-{version('degense')}-{version('numba')}-{sys.version_info.major}.{sys.version_info.minor}-{place}"


def start() -> subprocess.Popen[bytes] | None:
    """Compile in a process of low priority; None where that was done before. It ends by itself."""
    if _done().exists():
        return None
    return subprocess.Popen([sys.executable, "-m", "degense.app.warm_up"], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def compile_kernels() -> None:
    """Draw a frame of the sample and answer a prompt there: the kernels of the window's everyday work."""
    from degense.app.session.sample import demo_run
    from degense.engine.layers import LAYERS, LayerRequest
    from degense.engine.scene import Scene
    from degense.engine.scene.clip_query import decode_frame
    from degense.engine.semantics.prompts import PromptSet

    scene = Scene.open(demo_run(), device="cpu")
    scene.render_rgb(1)
    for name in ("displacement", "warp"):
        LAYERS[name].image(scene, LayerRequest(1))
    decode_frame(scene, PromptSet(("gallbladder",)), 1)


if __name__ == "__main__":
    if hasattr(os, "nice"):
        os.nice(10)
    compile_kernels()
    _done().parent.mkdir(parents=True, exist_ok=True)
    _done().touch()
