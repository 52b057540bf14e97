"""Opening clips and runs: dialogs, recent files, drops, and the loading itself in the worker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QMimeData, QObject, Signal
from PySide6.QtWidgets import QFileDialog

from degense.app.demo import demo_run, is_demo
from degense.app.features.clip_check.dialog import CheckDialog
from degense.app.features.documents.autosave import Keeping
from degense.app.session.session import Session
from degense.app.session.session_file import DamagedSession
from degense.app.shell.messages import show_error
from degense.app.shell.parts import Parts
from degense.app.shell.settings import SettingsFile
from degense.app.shell.worker import RenderService
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.data.readers import ClipOptions
    from degense.engine.scene import Scene


class Opening(QObject):
    """Opens what the user points at. The window stays alive meanwhile; a second opening replaces the first.

    Signals
    -------
    failed()
        It could not be opened; the user has been told.
    """

    failed = Signal()

    def __init__(self, session: Session, service: RenderService, settings: SettingsFile, parts: Parts, keeping: Keeping) -> None:
        super().__init__(parts)
        self.session, self.service, self.settings, self.parts = session, service, settings, parts
        self.keeping = keeping
        self.clip_answers: dict[str, Any] = {}
        self._check_next = False
        parts.facts.check_requested.connect(self.check)

    # Asking

    def ask_for_clip(self) -> None:
        folder = QFileDialog.getExistingDirectory(self.parts.window, "Open clip (a folder)", self.settings.value.last_folder)
        if folder:
            self._check_next = True
            self.open_path(Path(folder))

    def ask_for_video(self) -> None:
        kinds = "Videos (*.mp4 *.avi *.mov *.mkv *.webm);;All files (*)"
        file, _ = QFileDialog.getOpenFileName(self.parts.window, "Open video", self.settings.value.last_folder, kinds)
        if file:
            self._check_next = True
            self.open_path(Path(file))

    def ask_for_run(self) -> None:
        folder = QFileDialog.getExistingDirectory(self.parts.window, "Open run", self.settings.value.last_folder)
        if folder:
            self.open_path(Path(folder))

    def open_demo(self) -> None:
        self.open_path(demo_run())

    @staticmethod
    def dropped(mime: QMimeData) -> Path | None:
        """The file or folder in a drop; None when there is not exactly one."""
        paths = [Path(url.toLocalFile()) for url in mime.urls() if url.isLocalFile()]
        return paths[0] if len(paths) == 1 else None

    # Loading

    def open_path(self, path: Path, answers: dict[str, Any] | None = None) -> None:
        """Open a run folder or a clip. `answers` are `ClipOptions` that the user gave."""
        if not self.keeping.may_leave(lambda: self.open_path(path, answers)):
            return
        self.parts.set_busy(f"Opening {path.name}")
        if self.session.frames == 0:
            self.parts.panel.set_message(f"Opening {path.name} …")
        if (path / "run.json").is_file():
            self._load(path, lambda: _open_run(path), lambda scene: self._show_scene(path, scene))
        else:
            given = answers or {}
            self._load(path, lambda: _open_clip(path, given), lambda clip: self._show_clip(path, clip, given))

    def _load(self, path: Path, job: Callable[[], Any], show: Callable[[Any], None]) -> None:
        def done(result: Any) -> None:
            self.parts.set_busy()
            try:
                show(result)
            except DegenseError as error:
                show_error(self.parts.window, str(error))

        def failed(message: str) -> None:
            self.parts.set_busy()
            if not path.exists():
                self.settings.store(self.settings.value.forgotten(str(path)))
            if self.session.frames == 0:
                self.parts.panel.set_message(message)
            show_error(self.parts.window, message)
            self.failed.emit()

        self.service.submit("open", job, done, failed)

    def _show_scene(self, path: Path, scene: Scene) -> None:
        self.clip_answers = dict(scene.clip.options) if scene.clip else {}
        self._check_next = False
        self.parts.facts.show_facts(run_facts(scene), is_clip=False)
        self._remember(path)
        try:
            self.session.open_scene(scene, keep=not is_demo(path))
        except DamagedSession as error:
            self.parts.facts.show_facts([], is_clip=False)
            self.keeping.offer_backups(error, lambda: self.open_path(path))
            return
        self.parts.say(scene.clip_missing or f"{scene.name}: {scene.frames} frames")

    def _show_clip(self, path: Path, clip: Clip, answers: dict[str, Any]) -> None:
        self.clip_answers = answers
        self.parts.facts.show_facts(clip_facts(clip), is_clip=True)
        self.parts.facts_dock.show()
        self.parts.facts_dock.raise_()
        self._remember(path)
        self.parts.say(f"{clip.name}: check what was detected, then train.")
        try:
            self.session.open_clip(clip)
        except DegenseError as error:
            show_error(self.parts.window, str(error))
        if self._check_next:
            self._check_next = False
            self.check()

    def check(self) -> None:
        """Show what was found in the open clip on its pictures, and open it again with the answers."""
        clip = self.session.clip
        if clip is None or self.session.scene is not None:
            return
        dialog = CheckDialog(clip.path, clip, self.clip_answers, self.service, self.parts.window)

        def use() -> None:
            if dialog.answers != self.clip_answers:
                self.open_path(clip.path, dialog.answers)

        dialog.accepted.connect(use)
        dialog.open()

    def _remember(self, path: Path) -> None:
        if not is_demo(path):
            self.settings.store(self.settings.value.opened(path))


def _open_run(path: Path) -> Scene:
    from degense.engine.scene import Scene

    return Scene.open(path)


def _open_clip(path: Path, answers: dict[str, Any]) -> Clip:
    from degense.engine.data.readers import ClipOptions, open_clip

    options: ClipOptions = replace(ClipOptions(), **answers)
    return open_clip(path, options)


def clip_facts(clip: Clip) -> list[tuple[str, str]]:
    """What was detected, for the user to check."""
    width, height = clip.size
    rows = [("clip", clip.name), ("length", f"{len(clip)} frames, {width} × {height}")]
    rows += list(clip.provenance.items())
    return [*rows, ("classes", ", ".join(clip.classes))] if clip.classes else rows


def run_facts(scene: Scene) -> list[tuple[str, str]]:
    """What the run folder records."""
    info, width_height = scene.run.info, scene.clip_size
    rows = [
        ("run", scene.name),
        ("clip", str(info["clip"].get("path", ""))),
        ("length", f"{scene.frames} frames, {width_height[0]} × {width_height[1]}"),
        ("Gaussians", f"{info.get('gaussians', 0):,}"),
        ("trained", f"{info['config']['preset']}, {info['config']['routing']} routing, {info.get('train_seconds', 0):.0f} s"),
        ("teacher", f"{info['teacher']['name']}: {info['teacher']['provenance']}"),
        ("unit", f"{scene.unit}, displacement from frame {scene.reference_frame}"),
        ("classes", ", ".join(scene.classes) or "none"),
    ]
    if scene.clip_missing:
        rows.append(("missing", scene.clip_missing))
    return rows + [(key, text) for key, text in info.get("provenance", {}).items()]
