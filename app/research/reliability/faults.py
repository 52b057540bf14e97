"""What goes wrong around the program: disks, permissions, clocks, folders, memory, caches. Each case goes on, or says what to do."""

from __future__ import annotations

import ctypes
import io
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from degense.app.research.reliability import samples, stalled_work
from degense.app.research.reliability.guarded import READ, Fate, guarded
from degense.app.research.reliability.readers.sessions import opened_session, paint
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent

#: Linux' capget and capset: the version of their structures, and CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH.
CAPABILITIES, PAST_PERMISSIONS = 0x20080522, 0b110
SECONDS = 120.0


@dataclass(frozen=True)
class Fault:
    """`prepare(folder)` makes what is needed while all is well; `meet(folder)` goes on, raises a DegenseError, or is at fault."""

    name: str
    prepare: Callable[[Path], object]
    meet: Callable[[Path], object]


def faults() -> list[Fault]:
    """All of them."""
    writers = {"session": _save, "export": _export, "training": _train, "index": _index}
    found = [Fault(f"disk full: {name}", _ready, partial(_full, write)) for name, write in writers.items()]
    found += [Fault(f"read-only folder: {name}", _ready, partial(_read_only, write)) for name, write in writers.items()]
    return [
        *found,
        Fault("permission lost while a run is open", _ready, _permission_lost),
        Fault("clock that jumps back by a day", _ready, _clock),
        Fault("folder renamed under an open run", _ready, _renamed),
        Fault("stalling drive: a training with checkpoints is stopped", stalled_work.prepare, stalled_work.train_and_stop),
        Fault("stalling drive: a run is opened in the window", stalled_work.prepare, stalled_work.open_in_window),
        Fault("stalling drive: saved label maps are chosen", stalled_work.prepare, stalled_work.choose_labels),
        Fault("stalling drive: a run is played in the window", stalled_work.prepare, stalled_work.play_in_window),
        Fault("stalling drive: painting while it is saved", stalled_work.prepare, stalled_work.paint_and_save),
        Fault("memory of the GPU full in a training", _ready, _no_gpu_memory),
        Fault("CUDA promised and absent", _ready, _no_cuda),
        Fault("corrupted cache of kernels", _ready, _kernels),
    ]


def fates(scratch: Path, progress: Progress = silent) -> Iterator[tuple[str, Fate]]:
    """Name and fate of each case, which names files as they lie in its own folder."""
    cases = faults()
    for number, fault in enumerate(cases):
        progress(number / len(cases), fault.name)
        folder = scratch / f"{number:02d}"
        fate = meet(fault, folder)
        yield fault.name, replace(fate, words=fate.words.replace(f"{folder}{os.sep}", ""))


def meet(fault: Fault, scratch: Path) -> Fate:
    """One case in processes of its own. `scratch` is made, and taken away again."""
    scratch.mkdir(parents=True)
    made = guarded(lambda: fault.prepare(scratch), SECONDS, 16 << 10)
    if not made.sound:
        raise DegenseError(f"{fault.name} could not be prepared: {made.outcome} {made.words}")
    fate = guarded(lambda: fault.meet(scratch), SECONDS, 16 << 10)
    said = scratch / stalled_work.SAID
    if fate.outcome == READ and said.is_file():
        fate = replace(fate, words=said.read_text(encoding="utf-8"))
    shutil.rmtree(scratch, ignore_errors=True)
    return fate


def _ready(folder: Path) -> None:
    samples.phantom(folder / "clip")
    samples.run(folder / "run")
    shutil.copytree(folder / "run", folder / "work" / "one")
    paint(folder / "work")


# -- what is written -----------------------------------------------------------------------------------------------------------------------
def _save(folder: Path) -> None:
    session, annotations = opened_session(folder / "work")
    if session.store.unsaved:
        session.recover()
    annotations.add_class("kidney")
    session.save()


def _export(folder: Path) -> None:
    from degense.app.features.export.formats import FORMATS, ExportOptions
    from degense.engine.progress import finish
    from degense.engine.scene import Scene
    from degense.engine.semantics.prompts import PromptSet

    scene = Scene.open(folder / "run", device="cpu")
    finish(FORMATS["ply"].export(scene, folder / "work" / "out.ply", ExportOptions(PromptSet.chosen([], None, None))))


def _train(folder: Path) -> None:
    from degense.engine.data.readers import open_clip
    from degense.engine.training import TrainConfig, train

    small: dict[str, Any] = {"iterations": 4, "max_gaussians": 300, "resolution": 8, "channels": 8, "semantic_steps": 2, "device": "cpu"}
    train(
        open_clip(folder / "clip"),
        folder / "work" / "trained",
        TrainConfig.preset_of("quick", **small),
        events=lambda event: None,
        stop=lambda: False,
    )


def _index(folder: Path) -> None:
    from degense.engine.archive.indexing import update_index
    from degense.engine.progress import finish

    finish(update_index(folder / "work"))


def _full(write: Callable[[Path], None], folder: Path) -> None:
    """No file may grow beyond a kilobyte, which is what a full disk says to a writer. What was there is there still."""
    before = {path: path.read_bytes() for path in (folder / "work").rglob("*.json")}
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    try:
        write(folder)
    finally:
        changed = [
            path.name for path, data in before.items() if not path.exists() or (path.read_bytes() != data and path.stat().st_size == 0)
        ]
        assert not changed, f"{changed} was there before and is damaged"


def _obey_permissions() -> None:
    """The superuser may read and write everything: from here on only what the permissions of its own files allow (Linux)."""
    if os.geteuid():
        return
    libc, header, sets = ctypes.CDLL(None, use_errno=True), (ctypes.c_uint32 * 2)(CAPABILITIES, 0), (ctypes.c_uint32 * 6)()
    if libc.capget(header, sets):
        raise OSError(ctypes.get_errno(), "capget")
    for effective_or_permitted in (0, 1):
        sets[effective_or_permitted] &= ~PAST_PERMISSIONS
    if libc.capset(header, sets):
        raise OSError(ctypes.get_errno(), "capset")


def _read_only(write: Callable[[Path], None], folder: Path) -> None:
    (folder / "work").chmod(0o555)
    _obey_permissions()
    write(folder)


def _permission_lost(folder: Path) -> None:
    """A clip's frames and the folder of its session can no longer be used, in the middle of the work."""
    from degense.engine.data.readers import open_clip

    clip = open_clip(folder / "clip")
    session, annotations = opened_session(folder / "work")
    if session.store.unsaved:
        session.recover()
    for path in (folder / "clip" / "images").iterdir():
        path.chmod(0)
    (folder / "work").chmod(0o555)
    _obey_permissions()
    annotations.add_class("kidney")  # the journal, elsewhere or here, takes it or a sentence says that it does not
    clip.frame(0)


def _clock(folder: Path) -> None:
    """Saved, painted on, saved a day earlier, and opened again: the last state is there."""
    session, annotations = opened_session(folder / "work")
    if session.store.unsaved:
        session.recover()
    session.save()
    clock = time.time
    time.time = lambda: clock() - 86_400
    annotations.add_class("kidney")
    session.save()
    session.close()
    _, annotations = opened_session(folder / "work")
    assert annotations.work is not None
    assert "kidney" in [kind.name for kind in annotations.work.classes], "what was saved is not what is opened"


def _renamed(folder: Path) -> None:
    """An open run still draws; what is saved is in the folder, or a sentence says that it is gone."""
    from degense.engine.scene import Scene

    scene = Scene.open(folder / "run", device="cpu")
    session, annotations = opened_session(folder / "work")
    if session.store.unsaved:
        session.recover()
    (folder / "run").rename(folder / "moved")
    (folder / "work").rename(folder / "elsewhere")
    scene.render_rgb(1)
    annotations.add_class("kidney")
    session.save()


# -- GPUs and kernels ----------------------------------------------------------------------------------------------------------------------
def _no_gpu_memory(folder: Path) -> None:
    """torch says that the GPU is full in the middle of a training, which says what to lower and can be resumed to its end."""
    import torch

    from degense.app.cli.main import main
    from degense.engine.errors import OUT_OF_MEMORY
    from degense.engine.store import Run
    from degense.engine.training.trainer import Trainer

    step = Trainer.step

    def full(self: Trainer) -> None:
        if self.iteration == 40:
            raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")
        step(self)

    out = folder / "work" / "trained"
    words = ["--preset", "quick", "--iterations", "50", "--max-gaussians", "300", "--device", "cpu", "--set", "checkpoint_seconds=0"]
    command = ["train", str(folder / "clip"), "--out", str(out), *words]
    Trainer.step = full  # type: ignore[method-assign]
    with redirect_stderr(io.StringIO()) as said:
        status = main(command)
    Trainer.step = step  # type: ignore[method-assign]
    assert status == 2, f"the status is {status}"
    assert said.getvalue().splitlines()[-1:] == [f"degense: {OUT_OF_MEMORY}"], f"it said {said.getvalue()[-300:]!r}"
    assert (out / "checkpoints" / "last.json").is_file(), "there is no checkpoint"
    assert main([*command, "--resume"]) == 0, "it cannot be resumed"
    assert Run.open(out).info["state"] == "finished", "the resumed training is not finished"


def _no_cuda(folder: Path) -> None:
    import torch

    from degense.engine.training.config import choose_device

    torch.cuda.is_available = lambda: False
    choose_device("cuda")


def _kernels(folder: Path) -> None:
    """Compiled once; then every file of the cache is cut, or overwritten with noise; the next program computes the same."""
    code = "from degense.app.research.reliability.faults import kernel_answer; print(kernel_answer())"
    answers = []
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kernels")}
    for damage in (None, b"", b"\x80\x04noise" * 20):
        if damage is not None:
            files = list((folder / "kernels").rglob("*.nb[ic]"))
            assert files, "nothing was kept"
            for path in files:
                path.write_bytes(damage)
        result = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=110)
        assert result.returncode == 0, result.stderr.strip().splitlines()[-1:]
        answers.append(result.stdout.splitlines()[-1])
    assert len(set(answers)) == 1, answers


def kernel_answer() -> float:
    """A number that compiled kernels compute."""
    import numpy as np

    from degense.engine.semantics.masks.superpixels import superpixels

    image = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    return float(np.asarray(superpixels(image)).astype(np.float64).sum())
