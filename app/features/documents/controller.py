"""Opening clips and runs: dialogs, recent files, drops, and the loading itself in the worker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject, Signal

from degense.app.features.documents.autosave import Autosave
from degense.app.features.documents.fact_rows import clip_facts, run_facts
from degense.app.features.documents.facts import Facts
from degense.app.session.sample import demo_run, is_demo
from degense.app.session.saving import Reading
from degense.app.session.session import Reader
from degense.app.session.session_file import DamagedSession
from degense.app.session.state_folder import left_behind
from degense.app.shell.logs import hide_names
from degense.app.shell.shell import Shell
from degense.app.start_up import import_for_good
from degense.engine.errors import is_out_of_memory
from degense.engine.gpu import lacking_kernels
from degense.engine.progress import stoppable_reading

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene

#: How many of the runs and clips with work that was left behind are offered at once.
OFFERED = 3
VIDEOS = "Videos (*.mp4 *.avi *.mov *.mkv *.webm);;All files (*)"


class Documents(QObject):
    """Opens what the user points at. The window stays alive meanwhile; a second opening replaces the first."""

    loading = Signal(str)  # (name) something is being opened
    failed = Signal(str)  # (message) it could not be, and the error has been shown
    stopped = Signal()  # the user did not want it any more
    clip_opened = Signal(bool)  # (chosen) a clip without a run is open; `chosen` says whether the user has just picked it in a dialog

    def __init__(self, shell: Shell, autosave: Autosave) -> None:
        super().__init__(shell)
        self.shell, self.session, self.settings, self.autosave = shell, shell.session, shell.settings, autosave
        self.facts = Facts()
        self.facts_dock = shell.add_dock("Facts", self.facts)
        self.clip_options: dict[str, Any] = {}  # the `ClipOptions` that the user gave for the open clip
        self.path = Path()  # what is open, or is being shown
        self._chosen = False
        self._stop = Event()  # set when what is being opened is not wanted any more
        self._left: list[Path] = []  # what else holds work that an earlier start left behind, the newest first
        shell.worker.add_channel("open", 0)
        shell.dropped.connect(self.open_path)
        shell.closed.connect(self._forget_opening)
        self.session.store.problem_changed.connect(lambda problem: self._show_notice())

    def start(self, path: Path | None) -> None:
        """Open what the program was started with, else the newest work that was left behind. What else was is offered in a notice."""
        self._left = left_behind()
        if path is not None or self._left:
            self.open_path(path or self._left[0])
        self._show_notice()

    def _show_notice(self) -> None:
        """Say what cannot be saved, or what was left behind, and offer what helps, where it is in nobody's way."""
        store, opened = self.session.store, (self.path, self.clip_options)
        if store.elsewhere:
            self.shell.status.set_notice(store.problem, {"Open again": lambda: self.open_path(*opened)})
        elif store.problem:
            words = "Not saved, but kept in the journal on this computer" if store.journaled else "Not saved"
            self.shell.status.set_notice(f"{words}: {store.problem}", {"Save elsewhere…": self.autosave.save_elsewhere})
        else:
            links = {f"Open {path.parent.name}/{path.name}": partial(self.open_path, path) for path in self._left[:OFFERED]}
            count = len(self._left)
            which = "Another run or clip has" if count == 1 else f"{count} other runs and clips have"
            self.shell.status.set_notice(f"{which} unsaved work" if links else "", links)

    # Asking

    def ask_for_clip(self) -> None:
        self._open_chosen(self.shell.ask_folder("Open clip (a folder)", self.settings.value.last_folder))

    def ask_for_video(self) -> None:
        self._open_chosen(self.shell.ask_open("Open video", self.settings.value.last_folder, VIDEOS))

    def ask_for_run(self) -> None:
        if (folder := self.shell.ask_folder("Open run", self.settings.value.last_folder)) is not None:
            self.open_path(folder)

    def open_demo(self) -> None:
        self.open_path(demo_run())

    def close(self) -> None:
        """Close what is open, once it is saved."""
        if self.autosave.may_leave(self.close):
            self._forget_opening()
            self.path, self.clip_options = Path(), {}
            self.facts.show_facts([], is_clip=False)
            self.session.close()
            self.session.opened.emit()

    def _open_chosen(self, path: Path | None) -> None:
        if path is not None:
            self._chosen = True
            self.open_path(path)

    # Loading

    def open_path(self, path: Path, options: dict[str, Any] | None = None) -> None:
        """Open a run folder or a clip. `options` are `ClipOptions` that the user gave."""
        if not self.autosave.may_leave(lambda: self.open_path(path, options)):
            return
        hide_names(path)
        self.loading.emit(path.name)
        read, given = self.session.reader(), options or {}
        self._load(path, given, lambda: _open(path, given, read))

    def stop(self) -> None:
        """Stop opening; what is open stays."""
        self._forget_opening()
        self.autosave.stay()
        self.stopped.emit()

    def _forget_opening(self) -> None:
        self._stop.set()
        self.shell.worker.cancel("open")
        self.shell.set_busy()

    def _load(self, path: Path, options: dict[str, Any], job: Callable[[], Opened]) -> None:
        """Do the job in the worker, which stops at the next file when something else is to be opened, and show what it has opened."""
        self._stop.set()
        stop = self._stop = Event()

        def load() -> Opened:
            with stoppable_reading(stop.is_set):
                return job()

        def failed(message: str) -> None:
            if not path.exists():
                self.settings.change(lambda settings: settings.forgotten(str(path)))
            self.autosave.stay()
            self.failed.emit(message)

        self.shell.run_task("open", f"Opening {path.name}", load, partial(self._show, path, options), failed, stop=self.stop)

    def _show(self, path: Path, options: dict[str, Any], found: Opened) -> None:
        """Show what was loaded. What was done meanwhile in what is open is saved before, and read once more where it is the same."""
        if (self.session.dirty or self.autosave.saver.running) and not self.autosave.may_leave(lambda: self._show(path, options, found)):
            return
        if self.session.store.is_outdated(found.reading):
            read = self.session.reader()
            self._load(path, options, lambda: found.read_with(read))
            return
        self.path = path
        self._left = [left for left in self._left if left != found.reading.source]
        self._show_notice()
        if found.reading.keep:
            self.settings.change(lambda settings: settings.opened(path))
        chosen, self._chosen = self._chosen, False
        try:
            self._show_facts(found, options)
            self.session.open(found.scene, found.clip, found.reading)
        except DamagedSession as error:
            self.facts.show_facts([], is_clip=False)
            self.autosave.offer_backups(error, lambda: self.open_path(path, options))
            return
        if found.scene is None:
            self.clip_opened.emit(chosen)

    def _show_facts(self, found: Opened, options: dict[str, Any]) -> None:
        scene, clip = found.scene, found.clip
        if scene is not None:
            self.clip_options = dict(clip.options) if clip is not None else {}
            self.facts.show_facts(run_facts(scene), is_clip=False)
            self.shell.say(scene.clip_missing or lacking_kernels() or f"{scene.name}: {scene.frames} frames")
        elif clip is not None:
            self.clip_options = options
            self.facts.show_facts(clip_facts(clip), is_clip=True)
            self.shell.docks.bring(self.facts_dock)
            self.shell.say(f"{clip.name}: check what was detected, then train.")


@dataclass(frozen=True)
class Opened:
    """A run or a clip, and what is saved of it."""

    scene: Scene | None
    clip: Clip | None
    reading: Reading

    def read_with(self, read: Reader) -> Opened:
        """The same with what is saved now."""
        return replace(self, reading=read(self.scene, self.clip, self.reading.keep))


def _open(path: Path, answers: dict[str, Any], read: Reader) -> Opened:
    """Everything that is read from the drive when something is opened."""
    scene = _open_run(path) if (path / "run.json").is_file() else None
    clip = scene.clip if scene is not None else _open_clip(path, answers)
    return Opened(scene, clip, read(scene, clip, not is_demo(path)))


def _open_run(path: Path) -> Scene:
    import_for_good("degense.engine.scene")
    from degense.engine.scene import Scene

    try:
        return Scene.open(path)
    except Exception as error:
        if not is_out_of_memory(error):
            raise
    return Scene.open(path, device="cpu")  # the GPU is full


def _open_clip(path: Path, answers: dict[str, Any]) -> Clip:
    from degense.engine.data.readers import ClipOptions, open_clip

    return open_clip(path, ClipOptions(**answers))
