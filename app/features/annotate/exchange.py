"""Labels in and out: files of other tools, and the teacher of a further training."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from degense.app.features.annotate.label_sets import annotated, label_format, names_of, write_labels
from degense.app.features.annotate.state import folder_beside
from degense.app.features.train.controller import Training
from degense.app.session.session import Session
from degense.app.shell.messages import show_error
from degense.app.shell.parts import Parts
from degense.app.shell.worker import RenderService
from degense.engine.annotation.folder import NAME
from degense.engine.annotation.formats import MapSet
from degense.engine.errors import DegenseError

TEACHER = "teacher"


class Handing(QObject):
    """Reads and writes label maps in the worker while the window goes on."""

    def __init__(self, session: Session, service: RenderService, parts: Parts, training: Training) -> None:
        super().__init__(parts)
        self.session, self.service, self.parts, self.training = session, service, parts, training

    # Out

    def ask_to_export(self, name: str) -> None:
        chosen = label_format(name)
        proposal = f"{self.session.name}-{name}{chosen.suffix}"
        file, _ = QFileDialog.getSaveFileName(self.parts.window, f"Export labels as {chosen.title}", proposal, f"*{chosen.suffix}")
        if file:
            self.export(name, Path(file))

    def export(self, name: str, out: Path) -> None:
        """Write what is annotated to `out`."""
        maps = self._maps()
        self._submit(f"Exporting {out.name}", lambda: write_labels(name, maps, out), self.parts.say)

    def _maps(self) -> MapSet:
        """What is annotated now: painting goes on while it is written."""
        clip = self.session.clip
        maps = annotated(self.session.annotations.ready(), clip, clip.labelled_frames if clip is not None else [])
        labels = {frame: maps.read(frame) for frame in maps.frames}
        return MapSet(maps.classes, maps.shape, maps.names, maps.frames, labels.__getitem__)

    # In

    def ask_to_import(self, name: str) -> None:
        chosen, window = label_format(name), self.parts.window
        title = f"Import labels from {chosen.title}"
        if chosen.suffix:
            file, _ = QFileDialog.getOpenFileName(window, title, "", f"*{chosen.suffix};;All files (*)")
        else:
            file = QFileDialog.getExistingDirectory(window, title)
        if file:
            self.take(name, Path(file))

    def take(self, name: str, path: Path) -> None:
        """Read label maps; they replace those of their frames, as one step of undo."""
        session = self.session
        names, shape, opened = names_of(session.clip, session.frames), (session.size[1], session.size[0]), (session.scene, session.clip)

        def job() -> Any:
            maps = label_format(name).read(path, shape, names)
            labels = {}
            for done, frame in enumerate(maps.frames):
                yield done / len(maps.frames), f"frame {frame}"
                labels[frame] = maps.read(frame)
            return maps.classes, labels

        def done(found: Any) -> None:
            if opened == (session.scene, session.clip):
                classes, labels = found
                session.annotations.take(classes, labels, f"Import {path.name}")
                session.annotations.active = True
                self.parts.say(f"{path.name}: label maps of {len(labels)} frames")

        self._submit(f"Reading {path.name}", job, done)

    # The teacher

    def teach(self) -> None:
        """Offer a training that learns its classes from what is annotated."""
        session, maps = self.session, self._maps()
        if session.scene is not None:
            folder = session.scene.run.path / NAME / TEACHER
        else:
            assert session.clip is not None
            folder = folder_beside(session.clip) / TEACHER

        def job() -> Any:
            if folder.is_dir() and not folder.is_symlink():
                shutil.rmtree(folder)
            return write_labels("masks-png", maps, folder)

        self._submit("Writing the labels", job, lambda words: self.training.ask(folder))

    def _submit(self, words: str, job: Callable[[], Any], then: Callable[[Any], object]) -> None:
        def done(result: Any) -> None:
            self.parts.set_busy()
            try:
                then(result)
            except DegenseError as error:
                show_error(self.parts.window, str(error))

        def failed(message: str) -> None:
            self.parts.set_busy()
            show_error(self.parts.window, message)

        self.service.submit("export", job, done, failed, lambda step: self.parts.set_busy(words, step[0]))
