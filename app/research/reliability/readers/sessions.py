"""Sessions without a window: saved ones, and journals of what was not saved."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from degense.app.features.annotate.state import AnnotationState
from degense.app.features.cameras.state import CameraBook
from degense.app.features.events.state import Events
from degense.app.features.measure.state import Measures
from degense.app.features.prompts.mask_statistics import AreaCurves
from degense.app.features.tracks.state import TrackedPoints
from degense.app.research.reliability import samples
from degense.app.research.reliability.readers.reader import Reader
from degense.app.session.session import Session
from degense.app.session.state_folder import left_behind
from degense.engine.annotation.painting import brush


def session_readers() -> list[Reader]:
    return [
        Reader("session", _session, _use_session, ("**/session.json",)),
        Reader("journal", _journal, _use_session, ("**/session.journal",)),
    ]


def _states() -> tuple[Session, AnnotationState]:
    """A session without a window, with all states that are saved."""
    session = Session()
    annotations = AnnotationState(session)
    undone = {"cameras": CameraBook, "events": Events, "measures": Measures, "tracks": TrackedPoints}
    states = {"annotations": annotations, "areas": AreaCurves()} | {name: kind(session.undo) for name, kind in undone.items()}
    for name, state in states.items():
        session.register(name, state)
    return session, annotations


def opened_session(folder: Path) -> tuple[Session, AnnotationState]:
    """A session in which a run of the sample's size is open; its state folder lies beside it."""
    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    session, annotations = _states()
    run = SimpleNamespace(path=folder, info={})
    scene: Any = SimpleNamespace(name="sample", frames=samples.FRAMES, clip_size=(samples.WIDTH, samples.HEIGHT), clip=None, run=run)
    scene.classes, scene.labels, scene.question, scene.has_semantics = samples.CLASSES, lambda frame: None, lambda text: None, False
    session.open_scene(scene)
    return session, annotations


def paint(folder: Path) -> None:
    session, annotations = opened_session(folder)
    annotations.begin("Brush")
    for x in range(4, 20, 4):
        annotations.dab(brush((x, 10), (x + 4, 12), 3, samples.SHAPE))
    annotations.end()
    annotations.add_class("spleen")
    session.close()


def _session(folder: Path) -> Path:
    paint(folder)
    session, _ = opened_session(folder)
    session.recover()
    session.save()
    session.close()
    return folder


def _journal(folder: Path) -> Path:
    paint(folder)
    return folder


def _use_session(folder: Path) -> None:
    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    left_behind()
    session, annotations = opened_session(folder)
    if session.store.unsaved:
        session.recover()
    if annotations.work is not None:
        annotations.labels(0)
    session.save()
    session.close()
