"""What the features of a window have installed, for tests that drive it."""

from __future__ import annotations

from typing import TypeVar

from PySide6.QtWidgets import QDockWidget

from degense.app.features.annotate.controller import Annotator
from degense.app.features.annotate.exchange import LabelExchange
from degense.app.features.annotate.state import AnnotationState
from degense.app.features.archive.controller import ArchiveSearch
from degense.app.features.cameras.controller import Cameras
from degense.app.features.compare.controller import RunComparison
from degense.app.features.documents.autosave import Autosave
from degense.app.features.documents.controller import Documents
from degense.app.features.events.controller import EventMarks
from degense.app.features.export.controller import Exporter
from degense.app.features.inspect.findings import Findings
from degense.app.features.inspect.probe import Probe
from degense.app.features.measure.controller import Measuring
from degense.app.features.movies.install import Movies
from degense.app.features.preferences.controller import Preferences
from degense.app.features.prompts.controller import PromptControls
from degense.app.features.prompts.moments import MomentList
from degense.app.features.prompts.prompt_statistics import PromptStatistics
from degense.app.features.report.controller import Reporter
from degense.app.features.runs.runs_dialog import Runs
from degense.app.features.timeline.controller import TimeControl
from degense.app.features.tracks.controller import PointTracking
from degense.app.features.train.controller import Training
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.key_pointer import KeyPointer
from degense.app.features.viewer.layer_controls import LayerControls
from degense.app.shell.shell import Shell

Service = TypeVar("Service")


def found(window: Shell, kind: type[Service]) -> Service:
    """What a feature provides; it must be installed."""
    service = window.service(kind)
    assert service is not None, f"no feature provides a {kind.__name__}"
    return service


def time(window: Shell) -> TimeControl:
    return found(window, TimeControl)


def viewer(window: Shell) -> Viewer:
    return found(window, Viewer)


def pointer(window: Shell) -> KeyPointer:
    return found(window, KeyPointer)


def layers(window: Shell) -> LayerControls:
    return found(window, LayerControls)


def prompts(window: Shell) -> PromptControls:
    return found(window, PromptControls)


def statistics(window: Shell) -> PromptStatistics:
    return found(window, PromptStatistics)


def moments(window: Shell) -> MomentList:
    return found(window, MomentList)


def archive(window: Shell) -> ArchiveSearch:
    return found(window, ArchiveSearch)


def probe(window: Shell) -> Probe:
    return found(window, Probe)


def findings(window: Shell) -> Findings:
    return found(window, Findings)


def tracking(window: Shell) -> PointTracking:
    return found(window, PointTracking)


def measuring(window: Shell) -> Measuring:
    return found(window, Measuring)


def events(window: Shell) -> EventMarks:
    return found(window, EventMarks)


def reporter(window: Shell) -> Reporter:
    return found(window, Reporter)


def cameras(window: Shell) -> Cameras:
    return found(window, Cameras)


def movies(window: Shell) -> Movies:
    return found(window, Movies)


def comparison(window: Shell) -> RunComparison:
    return found(window, RunComparison)


def documents(window: Shell) -> Documents:
    return found(window, Documents)


def autosave(window: Shell) -> Autosave:
    return found(window, Autosave)


def annotator(window: Shell) -> Annotator:
    return found(window, Annotator)


def annotations(window: Shell) -> AnnotationState:
    return found(window, AnnotationState)


def exchange(window: Shell) -> LabelExchange:
    return found(window, LabelExchange)


def exporter(window: Shell) -> Exporter:
    return found(window, Exporter)


def training(window: Shell) -> Training:
    return found(window, Training)


def runs(window: Shell) -> Runs:
    return found(window, Runs)


def preferences(window: Shell) -> Preferences:
    return found(window, Preferences)


def dock(window: Shell, title: str) -> QDockWidget:
    """The panel with this title."""
    return next(dock for dock in window.docks.all if dock.objectName() == title)
