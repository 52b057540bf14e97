"""The power-cut model: what a program has synced is recorded, and laid out as the disk would show it had the power failed at a moment.

Only what was synced survives: the bytes of a file as they were at its last fsync, and its name as it was at the last fsync of its folder.
That is the worst that a file system may do; files whose bytes were never synced are empty then. What SQLite does is not seen: it syncs
by itself, from C.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import threading
import time
from pathlib import Path
from typing import Any

from degense.engine.errors import DegenseError


def record(root: Path, log: Path) -> None:
    """From now on write into the folder `log` what this process syncs below `root`, with the bytes."""
    log.mkdir(parents=True, exist_ok=True)
    lines, lock, fsync = (log / "events").open("a", encoding="utf-8"), threading.Lock(), os.fsync
    count, most = 0, resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    held: dict[int, int] = {}  # handles by inode: while one is open, no other file can get its number

    def synced(handle: int) -> None:
        nonlocal count
        path = Path(os.readlink(f"/proc/self/fd/{handle}"))
        if not path.is_relative_to(root):
            fsync(handle)
            return
        with lock:
            about: dict[str, Any] = {"inode": os.fstat(handle).st_ino}
            if about["inode"] not in held:
                held[about["inode"]] = os.dup(handle)
            if path.is_dir():
                about["names"] = {child.name: [child.is_dir(), child.lstat().st_ino] for child in path.iterdir()}
            else:
                count += 1
                about["bytes"] = count
                # by the handle: the file may have another name by now
                shutil.copyfile(f"/proc/self/fd/{handle}", log / str(count))
            fsync(handle)
            lines.write(json.dumps({**about, "time": time.monotonic()}) + "\n")
            lines.flush()

    os.fsync = synced  # type: ignore[assignment]


def moments(log: Path) -> tuple[float, float]:
    """When the first and the last event were, in seconds of the monotonic clock. DegenseError where there was none."""
    events = log / "events"
    times = [json.loads(line)["time"] for line in events.read_text(encoding="utf-8").splitlines()] if events.exists() else []
    if not times:
        raise DegenseError("nothing was synced in the time that was given; give more")
    return times[0], times[-1]


def lay_out(log: Path, moment: float, root_inode: int, target: Path) -> None:
    """Write into the empty folder `target` what the disk holds of `root` after a power cut at a moment."""
    files: dict[int, int] = {}
    folders: dict[int, dict[str, list[Any]]] = {}
    for line in (log / "events").read_text(encoding="utf-8").splitlines():
        event = json.loads(line)
        if event["time"] > moment:
            break
        if "names" in event:
            folders[event["inode"]] = event["names"]
        else:
            files[event["inode"]] = event["bytes"]
    _lay_out(root_inode, target, log, folders, files)


def _lay_out(inode: int, target: Path, log: Path, folders: dict[int, dict[str, list[Any]]], files: dict[int, int]) -> None:
    target.mkdir(exist_ok=True)
    for name, (is_folder, own) in folders.get(inode, {}).items():
        if is_folder:
            _lay_out(own, target / name, log, folders, files)
        elif own in files:
            shutil.copyfile(log / str(files[own]), target / name)
        else:
            (target / name).touch()
