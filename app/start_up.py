"""What makes the start of the window short: importing costs most of it, and torch most of that."""

from __future__ import annotations

import ctypes
import gc
import importlib
import importlib.util
import sys
import threading
from pathlib import Path
from types import ModuleType


def load_window() -> None:
    """Import what the window is made of, and let torch's libraries be loaded meanwhile."""
    load_libraries_ahead()
    import_for_good("degense.app.application")


def import_for_good(name: str) -> ModuleType:
    """Import a module that stays, without looking for garbage meanwhile: there is none, and each search goes through all that is there.

    What the program has then is left out of later searches too, which would stop every thread for as long.
    """
    if name in sys.modules:
        return importlib.import_module(name)
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.freeze()
        gc.enable()


def load_libraries_ahead() -> threading.Thread:
    """Let the system load torch's libraries, which are used later, in a thread without Python's lock, while the window is built."""
    thread = threading.Thread(target=_load_libraries, name="libraries", daemon=True)
    thread.start()
    return thread


def _load_libraries() -> None:
    torch = importlib.util.find_spec("torch") if sys.platform == "linux" else None  # without importing it
    if torch is None or torch.origin is None:
        return
    try:
        ctypes.CDLL(str(Path(torch.origin).parent / "lib" / "libtorch_python.so"))
    except OSError:
        return  # importing torch itself tells what is wrong, where it is needed
