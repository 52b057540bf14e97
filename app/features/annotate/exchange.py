"""Label maps from and to files of other tools, and the labels of a further training."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject

from degense.app.features.annotate.label_sets import label_format, names_of, write_labels
from degense.app.features.annotate.state import AnnotationState
from degense.app.features.train.controller import Training
from degense.app.shell.shell import Shell

TEACHER = "teacher"


class LabelExchange(QObject):
    """Reads and writes label maps in the worker while the window goes on."""

    def __init__(self, shell: Shell, state: AnnotationState, training: Training | None) -> None:
        super().__init__(shell)
        self.shell, self.session, self.state, self.training = shell, shell.session, state, training

    def ask_to_import(self, name: str) -> None:
        chosen = label_format(name)
        title = f"Import labels from {chosen.title}"
        kinds = f"*{chosen.suffix};;All files (*)"
        path = self.shell.ask_open(title, "", kinds) if chosen.suffix else self.shell.ask_folder(title)
        if path is not None:
            self.take(name, path)

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
                self.state.take(classes, labels, f"Import {path.name}")
                self.state.tool.active = True
                self.shell.say(f"{path.name}: label maps of {len(labels)} frames")

        self.shell.run_task("export", f"Reading {path.name}", job, done)

    def teach(self) -> None:
        """Offer a training of which the teacher are the annotated labels."""
        maps, training = self.state.snapshot(), self.training
        assert self.state.folder is not None
        folder = self.state.folder / TEACHER

        def job() -> Any:
            if folder.is_dir() and not folder.is_symlink():
                shutil.rmtree(folder)
            return write_labels("masks-png", maps, folder)

        if training is not None:
            self.shell.run_task("export", "Writing the labels", job, lambda text: training.ask(folder))
